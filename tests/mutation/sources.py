"""Which sources are mutated, and the test programs that have to notice, in the order in which they
are asked: one line for each."""

SOURCES = [
    ("can_bridge/safety/*.cpp", ["can_safety_test", "can_bridge_node_test"]),
    ("can_bridge/node/can_bridge_node.cpp", ["can_bridge_node_test"]),
    ("can_bridge/node/estop_file.cpp", ["can_bridge_node_test"]),
    ("can_bridge/commission/*.cpp", ["commission_test"]),
    ("can_bridge/cia402/*.cpp", ["can_profile_test", "drivetrain_config_test", "emulated_bring_up_test"]),
    ("can_bridge/agilex/*.cpp", ["agilex_v2_test"]),
    ("can_bridge/bus/in_process_can.cpp", ["in_process_can_test"]),
    ("common/vehicle/*.cpp", ["common_test"]),
    ("common/node/stream_guard.cpp", ["common_test"]),
    ("common/world/stopping_field.cpp", ["autonomy_test"]),
    ("onboard/autonomy/supervisor.cpp", ["autonomy_test"]),
    ("onboard/autonomy/obstacle_field.cpp", ["autonomy_test"]),
    ("onboard/autonomy/swept_way.cpp", ["autonomy_test"]),
    ("onboard/autonomy/onboard_driver.cpp", ["autonomy_test"]),
    ("onboard/localiser/localiser.cpp", ["localiser_test"]),
    ("onboard/localiser/localiser_node.cpp", ["localiser_test"]),
    ("doors/link/handshake.cpp", ["link_test", "link_paths_test"]),
    ("doors/link/sessions.cpp", ["link_test", "link_paths_test"]),
    ("doors/link/peer_link.cpp", ["link_test", "link_paths_test"]),
    ("doors/link/path_fates.cpp", ["link_paths_test"]),
    ("doors/link/key_file.cpp", ["link_test"]),
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
