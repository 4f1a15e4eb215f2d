# Tests of experiments: sweeps, statistics, figures, reports.
tether_add_test(NAME experiment_test SOURCES experiment_test.cpp experiment_axes_test.cpp
  run_store_test.cpp sweep_schedule_test.cpp sweep_tables_test.cpp claims_test.cpp LIBS tether_experiment)
tether_add_test(NAME sweep_test SOURCES sweep_test.cpp LIBS tether_experiment LABELS loop)
tether_add_test(NAME experiment_statistics_test
  SOURCES experiment_statistics_test.cpp experiment_comparison_test.cpp
  LIBS tether_experiment_statistics LABELS slow)
tether_add_test(NAME paper_claims_test SOURCES paper_claims_test.cpp LIBS tether_experiment
  LABELS slow ONE_PROCESS)
tether_add_test(NAME experiment_figures_test SOURCES experiment_figures_test.cpp
  LIBS tether_experiment_figures)

# Real processes, but nothing in them depends on wall time: they need not be alone.
add_test(NAME sweep_survival_test COMMAND
  ${CMAKE_CURRENT_SOURCE_DIR}/sweep_survival_test.py ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
set_tests_properties(sweep_survival_test PROPERTIES LABELS live TIMEOUT 300)
add_test(NAME slurm_test COMMAND
  ${CMAKE_CURRENT_SOURCE_DIR}/slurm_test.py ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
set_tests_properties(slurm_test PROPERTIES LABELS live TIMEOUT 400)
add_test(NAME report_page_test COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/in_own_network.sh
  ${CMAKE_CURRENT_SOURCE_DIR}/report_page_test.py ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
set_tests_properties(report_page_test PROPERTIES LABELS live TIMEOUT 300)
