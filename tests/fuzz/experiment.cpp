#include "tools/experiment/sweep/experiment.hpp"

#include "tests/fuzz/fuzz.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/source_dir.hpp"

namespace tether::fuzzing {

/// An experiment beside the paper's scenario.
void try_input(std::span<const std::uint8_t> input) {
  static const test::Folder folder;
  static const auto scenario =
      folder.file("paper.toml", test::contents(in_source("/scenarios/paper.toml")));
  const auto file = folder.file("experiment.toml", text_of(input));
  takes([&] {
    const Experiment experiment = load_experiment(file);
    must(!experiment.arms.empty(), "an experiment has an arm");
    must(!experiment.seeds.empty(), "an experiment has a seed");
    for (const std::size_t n : {std::size_t{0}, experiment.seeds.size() - 1}) {
      const std::size_t arm = experiment.arms.size() - 1;
      must(experiment.number(arm, experiment.seed(arm, n)) == n, "a seed tells its run");
    }
  });
}

}  // namespace tether::fuzzing
