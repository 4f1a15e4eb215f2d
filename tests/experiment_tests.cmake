#Tests of the statistics and figures of experiments.
tether_add_test(NAME experiment_statistics_test SOURCES experiment_statistics_test.cpp LIBS
                    tether_experiment_statistics)
    tether_add_test(NAME experiment_comparison_test SOURCES experiment_comparison_test.cpp LIBS
                        tether_experiment_statistics)
tether_add_test(NAME experiment_figures_test SOURCES experiment_figures_test.cpp
  LIBS tether_experiment_figures)
