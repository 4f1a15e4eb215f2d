# Our channel against the kernel's own netem, and the statistics for that.
tether_add_test(NAME two_sample_test SOURCES two_sample_test.cpp two_sample.cpp
  LIBS tether_common Boost::headers)

# Label kernel: runs where tc has netem (uml/with_can.sh --netem).
add_executable(netem_kernel_test
  loss_statistics.cpp
  netem_kernel_delay_test.cpp
  netem_kernel_loss_test.cpp
  two_sample.cpp
  udp_probe.cpp)
target_link_libraries(netem_kernel_test PRIVATE tether_netem_core
  nlohmann_json::nlohmann_json tether_options GTest::gmock GTest::gtest_main)
set_target_properties(netem_kernel_test PROPERTIES
  RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
tether_add_can_test(NAME netem_kernel_test PROGRAM netem_kernel_test TIMEOUT 120 NETEM)
