tether_add_test(NAME controller_test SOURCES controller_node_test.cpp pid_test.cpp
  LIBS tether_controller_core)
tether_add_test(NAME netem_test SOURCES netem_test.cpp LIBS tether_netem_core)
tether_add_test(NAME sim_test SOURCES sim_node_test.cpp wheel_coupling_test.cpp
  LIBS tether_sim_core)
tether_add_test(NAME closed_loop_test SOURCES closed_loop_test.cpp
  LIBS tether_closed_loop tether_tools_core LABELS loop)
tether_add_test(NAME baseline_test SOURCES baseline_test.cpp LIBS tether_closed_loop LABELS slow)
tether_add_test(NAME plant_test SOURCES plant_test.cpp LIBS tether_sim_core)
