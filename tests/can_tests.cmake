# The CAN drivetrain. Each block below is a program of its own.

# --- protocol and profiles
tether_add_test(NAME can_protocol_test SOURCES canopen_test.cpp LIBS tether_can_protocol)
tether_add_test(NAME can_profile_test
  SOURCES sdo_client_test.cpp cia402_axis_test.cpp cia402_startup_test.cpp
    cia402_refusal_test.cpp cia402_profile_test.cpp cia402_stop_test.cpp cia402_fault_test.cpp
    cia402_reset_test.cpp cia402_intruder_test.cpp cia402_layout_test.cpp
    cia402_standstill_test.cpp
  LIBS tether_can_profiles)

# --- configuration and AgileX
tether_add_test(NAME drivetrain_config_test
  SOURCES drivetrain_config_test.cpp drivetrain_files_test.cpp drivetrain_reaction_test.cpp
  LIBS tether_can_protocol)
tether_add_test(NAME can_probe_test SOURCES can_probe_test.cpp sdo_upload_test.cpp
  LIBS tether_can_protocol tether_can_emulation)
tether_add_test(NAME can_request_test SOURCES can_request_test.cpp twist_drive_test.cpp
  LIBS tether_tools_core)
tether_add_test(NAME agilex_v2_test
  SOURCES agilex_v2_test.cpp agilex_v2_profile_test.cpp emulated_agilex_v2_test.cpp
  LIBS tether_can_profiles tether_can_emulation)

# --- emulated drives
tether_add_test(NAME emulated_drive_test
  SOURCES emulated_axis_test.cpp emulated_fault_test.cpp emulated_layout_test.cpp
    emulated_node_test.cpp emulated_objects_test.cpp emulated_pdo_test.cpp emulated_wheel_test.cpp
  LIBS tether_can_emulation)
tether_add_test(NAME emulated_bring_up_test
  SOURCES emulated_bring_up_test.cpp emulated_restart_test.cpp
  LIBS tether_can_profiles tether_can_emulation)
tether_add_test(NAME can_drive_node_test SOURCES can_drive_node_test.cpp LIBS tether_can_drive_core)

# --- safety core and bridge node
tether_add_test(NAME can_safety_test
  SOURCES twist_limiter_test.cpp safety_arming_test.cpp safety_core_test.cpp safety_latch_test.cpp
    safety_again_test.cpp
    safety_bus_test.cpp safety_inputs_test.cpp safety_plan_test.cpp follow_monitor_test.cpp odometry_test.cpp
  LIBS tether_can_bridge_core)
tether_add_test(NAME can_bridge_node_test
  SOURCES can_bridge_node_test.cpp can_bridge_late_test.cpp
  LIBS tether_can_bridge_core)
# Label mutation: takes each safety rule out and checks that one of the tests above notices.
if(NOT TETHER_SANITIZE)
  set(mutation_libraries tether_can_bridge_core tether_can_profiles tether_can_protocol tether_common
    fmt::fmt GTest::gtest_main GTest::gmock GTest::gtest lcm::lcm)
  list(TRANSFORM mutation_libraries REPLACE "(.+)" "$<TARGET_LINKER_FILE:\\1>")
  list(APPEND mutation_libraries ${TOMLPLUSPLUS_LINK_LIBRARIES} ${RE2_LINK_LIBRARIES})
  list(JOIN mutation_libraries "," mutation_libraries)
  add_test(NAME safety_mutations COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/mutation/safety_mutations.py
    --build ${CMAKE_BINARY_DIR}
    --objects can_safety_test=$<JOIN:$<TARGET_OBJECTS:can_safety_test>,$<COMMA>>
    --objects can_bridge_node_test=$<JOIN:$<TARGET_OBJECTS:can_bridge_node_test>,$<COMMA>>
    --link ${mutation_libraries})
  set_tests_properties(safety_mutations PROPERTIES LABELS mutation TIMEOUT 1500)
endif()

tether_add_test(NAME can_golden_test SOURCES can_golden_test.cpp
  LIBS tether_can_bridge_core tether_can_drive_core tether_can_bus)

# --- SocketCAN and vcan (label vcan)
# tether_add_can_test(NAME name {SCRIPT file | PROGRAM target} TIMEOUT seconds [NETEM]): runs
# `file BIN_DIR` or the program where CAN interfaces can be made, or with NETEM where tc has netem
# (uml/with_can.sh). What it writes to $TETHER_CAN_RESULTS stays in the build folder's can_results/.
# Labels vcan or kernel, and where they run.
function(tether_add_can_test)
  cmake_parse_arguments(T "NETEM" "NAME;SCRIPT;PROGRAM;TIMEOUT" "" ${ARGN})
  if(T_NETEM)
    set(network --netem)
    set(labels kernel ${netem_kernel})
  else()
    set(network)
    set(labels vcan ${can_kernel})
  endif()
  if(T_PROGRAM)
    set(command $<TARGET_FILE:${T_PROGRAM}>)
  else()
    set(command ${CMAKE_CURRENT_SOURCE_DIR}/${T_SCRIPT} ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
  endif()
  if(TETHER_SANITIZE)  # AddressSanitizer's shadow is larger than User-Mode Linux's address space
    if(T_PROGRAM)
      set_target_properties(${T_PROGRAM} PROPERTIES EXCLUDE_FROM_ALL TRUE)
    endif()
    return()
  endif()
  set(results ${CMAKE_BINARY_DIR}/can_results/${T_NAME})
  file(MAKE_DIRECTORY ${results})
  add_test(NAME ${T_NAME} COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/uml/with_can.sh
    ${network} ${command})
  math(EXPR own "3 * ${T_TIMEOUT}")  # parts that met a pause of this machine are run again
  math(EXPR timeout "${own} + 20")  # with_can.sh's own comes first, and says more
  set_tests_properties(${T_NAME} PROPERTIES LABELS "${labels}" TIMEOUT ${timeout}
    RESOURCE_LOCK processor_of_uml COST 300
    ENVIRONMENT "TETHER_CAN_TIMEOUT=${own};TETHER_CAN_RESULTS=${results}")
endfunction()

# Where they run is a label too: native or uml; none, if they cannot run here and will fail.
function(tether_find_kernel variable)
  execute_process(COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/uml/with_can.sh ${ARGN} --where
    OUTPUT_VARIABLE kernel ERROR_QUIET)
  string(REGEX MATCH "native|User-Mode" kernel "${kernel}")
  string(REPLACE "User-Mode" "uml" kernel "${kernel}")
  if(NOT kernel)
    set(kernel none)
  endif()
  set(${variable} ${kernel} PARENT_SCOPE)
endfunction()
tether_find_kernel(can_kernel)
tether_find_kernel(netem_kernel --netem)

add_executable(socket_can_test socket_can_test.cpp socket_can_controller_test.cpp)
target_link_libraries(socket_can_test PRIVATE
  tether_can_bus tether_options GTest::gmock GTest::gtest_main)
set_target_properties(socket_can_test PROPERTIES
  RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
tether_add_can_test(NAME can_harness_test SCRIPT can_harness_test.py TIMEOUT 180)
tether_add_can_test(NAME socket_can_test PROGRAM socket_can_test TIMEOUT 180)
tether_add_can_test(NAME can_startup_test SCRIPT can_startup_test.py TIMEOUT 180)
tether_add_can_test(NAME can_motion_test SCRIPT can_motion_test.py TIMEOUT 150)
tether_add_can_test(NAME can_failure_test SCRIPT can_failure_test.py TIMEOUT 200)
tether_add_can_test(NAME can_network_failure_test SCRIPT can_network_failure_test.py TIMEOUT 150)
tether_add_can_test(NAME can_bus_trouble_test SCRIPT can_bus_trouble_test.py TIMEOUT 200)
tether_add_can_test(NAME can_bad_input_test SCRIPT can_bad_input_test.py TIMEOUT 200)
tether_add_can_test(NAME can_bad_command_test SCRIPT can_bad_command_test.py TIMEOUT 200)
tether_add_can_test(NAME can_replay_test SCRIPT can_replay_test.py TIMEOUT 200)
tether_add_can_test(NAME can_tools_test SCRIPT can_tools_test.py TIMEOUT 200)
tether_add_can_test(NAME can_hil_test SCRIPT can_hil_test.py TIMEOUT 300)
tether_add_script_test(NAME can_bad_config_test SCRIPT can_bad_config_test.py TIMEOUT 60)

# --- in-process bus and closed loop over CAN
tether_add_test(NAME in_process_can_test SOURCES in_process_can_test.cpp LIBS tether_can_bus)
tether_add_test(NAME can_loop_test SOURCES can_loop_test.cpp can_plan_loop_test.cpp
  LIBS tether_closed_loop tether_tools_core LABELS loop)
