"""Which sources are mutated, and the test programs that have to notice, in the order in which they
are asked: one line for each."""

SOURCES = [
    ("can_bridge/safety/*.cpp", ["can_safety_test", "can_bridge_node_test"]),
    ("can_bridge/motion/*.cpp", ["can_safety_test"]),
    ("can_bridge/node/can_bridge_node.cpp", ["can_bridge_node_test"]),
    ("can_bridge/node/autonomy_watch.cpp", ["can_bridge_node_test"]),
    ("can_bridge/node/estop_file.cpp", ["can_bridge_node_test"]),
    ("can_bridge/commission/*.cpp", ["commission_test"]),
    ("can_bridge/cia402/*.cpp", ["can_profile_test", "drivetrain_config_test"]),
    ("can_bridge/cia402/drives/*.cpp", ["can_profile_test", "emulated_bring_up_test"]),
    ("can_bridge/cia402/profile/*.cpp", ["can_profile_test", "emulated_bring_up_test"]),
    ("can_bridge/agilex/*.cpp", ["agilex_v2_test"]),
    ("can_bridge/bus/in_process_can.cpp", ["in_process_can_test"]),
    ("common/actuator/*.cpp", ["common_test"]),
    ("common/vehicle/*.cpp", ["common_test"]),
    ("common/bus/stream_guard.cpp", ["common_test"]),
    ("common/onboard/stopping_field.cpp", ["autonomy_test"]),
    ("autonomy/supervisor/supervisor.cpp", ["autonomy_test"]),
    ("autonomy/supervisor/setpoint.cpp", ["autonomy_test"]),
    ("autonomy/field/*.cpp", ["autonomy_test"]),
    ("autonomy/node/onboard_driver.cpp", ["autonomy_test"]),
    ("localiser/core/localiser.cpp", ["localiser_test"]),
    ("localiser/node/localiser_node.cpp", ["localiser_test"]),
    ("link/session/*.cpp", ["link_test", "link_paths_test"]),
    ("link/peer/*.cpp", ["link_test", "link_paths_test"]),
    ("link/paths/path_fates.cpp", ["link_paths_test"]),
    ("link/keys/key_file.cpp", ["link_test"]),
]

# The same of sources that need a kernel with CAN.
CAN_SOURCES = [
    ("can_bridge/bus/socket_can_port.cpp", ["socket_can_test"]),
    ("can_bridge/bus/link_service.cpp", ["socket_can_test"]),
]

# In these files, with these operators, no mutant may live that survivors.toml does not name.
STRICT = [
    ("can_bridge/agilex/v2_profile", ["true", "false", "drop", "operand"]),
    ("can_bridge/bus/in_process_can", ["true", "false", "drop", "operand"]),
]
