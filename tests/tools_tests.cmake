# Tests of tether echo, tether log, tether spy and of the work with LCM's own tools.
tether_add_test(NAME stream_statistics_test SOURCES stream_statistics_test.cpp
  LIBS tether_tools_core)
tether_add_test(NAME message_printer_test SOURCES message_printer_test.cpp LIBS tether_tools_core)
tether_add_test(NAME event_log_test SOURCES event_log_test.cpp LIBS tether_tools_core)

tether_add_script_test(NAME echo_test SCRIPT echo_test.sh LABELS live TIMEOUT 120)
tether_add_script_test(NAME log_test SCRIPT log_test.sh LABELS live TIMEOUT 60)
tether_add_script_test(NAME logger_test SCRIPT logger_test.sh LABELS live TIMEOUT 180)
tether_add_script_test(NAME spy_test SCRIPT spy_test.sh LABELS live TIMEOUT 180)
tether_add_test(NAME netem_fit_files_test SOURCES netem_fit_files_test.cpp
  LIBS tether_netem_fit_files tether_tools_core)
tether_add_script_test(NAME netem_commands_test SCRIPT netem_commands_test.py LABELS live
  TIMEOUT 120)
tether_add_test(NAME channel_figure_test SOURCES channel_figure_test.cpp LIBS tether_tools_core)
