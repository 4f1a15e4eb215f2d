# common/: one program for everything that needs neither wall time nor sockets.
tether_add_test(NAME common_test
  SOURCES
    actuator_test.cpp
    cli_test.cpp
    diff_drive_test.cpp
    figure_eight_test.cpp
    in_process_bus_test.cpp
    lcm_datagrams_test.cpp
    lcm_url_test.cpp
    message_io_test.cpp
    pattern_test.cpp
    plan_buffer_test.cpp
    plan_order_test.cpp
    random_test.cpp
    scenario_change_test.cpp
    scenario_channel_test.cpp
    scenario_override_test.cpp
    scenario_test.cpp
    stream_guard_test.cpp
    time_test.cpp
    virtual_loop_test.cpp
  LIBS tether_common tether_node_main)

tether_add_test(NAME real_time_loop_test
  SOURCES real_time_loop_test.cpp
  LIBS tether_common
  LABELS live)

# Real LCM, in a network of its own: one CTest for the whole program.
add_executable(lcm_bus_test lcm_bus_test.cpp udpm_bus_test.cpp)
target_link_libraries(lcm_bus_test PRIVATE tether_common tether_options
  GTest::gmock GTest::gtest_main)
set_target_properties(lcm_bus_test PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
add_test(NAME lcm_bus_test
  COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/in_own_network.sh $<TARGET_FILE:lcm_bus_test>)
set_tests_properties(lcm_bus_test PROPERTIES LABELS live TIMEOUT 120 RUN_SERIAL TRUE)
