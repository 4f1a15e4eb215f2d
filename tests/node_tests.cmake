tether_add_test(NAME controller_test
  SOURCES
    controller_node_test.cpp
    controller_plan_test.cpp
    network_estimate_test.cpp
    pid_test.cpp
    predictive_law_test.cpp
    tracking_law_test.cpp
  LIBS tether_controller_core)
tether_add_test(NAME netem_test
  SOURCES
    loss_statistics.cpp
    netem_chain_test.cpp
    netem_change_test.cpp
    netem_delay_test.cpp
    netem_fate_test.cpp
    netem_memory_test.cpp
    netem_node_test.cpp
    netem_refusal_test.cpp
    netem_set_test.cpp
    netem_slots_test.cpp
    netem_stages_test.cpp
    netem_test.cpp
  LIBS tether_netem_core)
tether_add_test(NAME netem_loss_test SOURCES loss_statistics.cpp netem_loss_test.cpp
  LIBS tether_netem_core LABELS slow)
tether_add_test(NAME relay_test
  SOURCES relay_node_test.cpp relay_rule_test.cpp
  LIBS tether_netem_core)
tether_add_test(NAME sim_test SOURCES plan_stream_test.cpp sim_node_test.cpp sim_plan_test.cpp
  vehicle_errors_test.cpp wheel_coupling_test.cpp
  LIBS tether_sim_core)
tether_add_test(NAME closed_loop_test
  SOURCES channel_watch_test.cpp closed_loop_test.cpp kinematic_loop_test.cpp netem_loop_test.cpp
    path_loop_test.cpp
  LIBS tether_closed_loop tether_tools_core LABELS loop)
tether_add_test(NAME lockstep_test SOURCES lockstep_test.cpp LIBS tether_closed_loop LABELS loop
  ONE_PROCESS)
tether_add_test(NAME baseline_test SOURCES baseline_test.cpp control_targets_test.cpp
  LIBS tether_closed_loop LABELS slow)
tether_add_test(NAME plant_test SOURCES kinematic_vehicle_test.cpp plant_test.cpp LIBS tether_sim_core)
tether_add_test(NAME netem_statistics_test SOURCES netem_statistics_test.cpp netem_check_test.cpp
  LIBS tether_netem_statistics)
tether_add_test(NAME loss_intervals_test SOURCES loss_intervals_test.cpp
  LIBS tether_netem_statistics LABELS slow)
tether_add_test(NAME netem_fit_test SOURCES netem_fit_test.cpp netem_fit_data_test.cpp
  LIBS tether_netem_statistics
  LABELS slow)
tether_add_test(NAME netem_playback_test SOURCES netem_trace_test.cpp netem_map_test.cpp
  LIBS tether_netem_playback tether_common)
tether_add_test(NAME netem_link_check_test SOURCES netem_link_check_test.cpp
  LIBS tether_netem_check LABELS slow)
tether_add_test(NAME tc_export_test SOURCES tc_export_test.cpp LIBS tether_netem_check)
