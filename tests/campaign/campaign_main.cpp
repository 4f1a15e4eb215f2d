#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <optional>
#include <string>

#include "common/program/cli.hpp"
#include "tests/campaign/campaign.hpp"

// Seeded runs of random faults against the rules of rules.hpp: see
// docs/explanation/drivetrain-tests.md.

namespace tether::campaign {
namespace {

struct Options {
  Campaign campaign;
  std::optional<std::uint64_t> seed;
  bool verbose = false;
  std::string enumerate;  // "single", "pairs": instead of seeds
};

/// The command that runs this seed again.
std::string again(std::uint64_t seed) {
  return fmt::format("fault_campaign --seed {} --verbose", seed);
}

void tell(const Finding& f) {
  fmt::print("seed {}: {} at {:.3f} s: {}\n    {}\n", f.seed, f.rule, to_seconds(f.when), f.what,
             again(f.seed));
}

int run_one(const Options& options) {
  const Setup setup = load_setup();
  const Record record = run_trial(setup, with_vehicle(draw_trial(*options.seed)), options.verbose);
  for (const std::string& note : record.notes) fmt::print("{}\n", note);
  const auto found = check(*options.seed, record);
  for (const Finding& f : found) tell(f);
  fmt::print("{} violations\n", found.size());
  return found.empty() ? kExitOk : kExitFailed;
}

int run_many(const Options& options) {
  const auto begin = std::chrono::steady_clock::now();
  const std::clock_t cpu = std::clock();
  const Totals totals = run_campaign(load_setup(), options.campaign, [&](std::uint64_t begun) {
    fmt::print(stderr, "{} of {} runs\n", begun, options.campaign.runs);
  });
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  const double cpu_s = static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC;
  for (const Finding& f : totals.findings) tell(f);
  fmt::print("{}", totals.text());
  fmt::print(stderr, "{:.1f} s, {:.0f} runs for each second of a processor\n", took.count(),
             static_cast<double>(totals.runs) / cpu_s);
  return totals.findings.empty() ? kExitOk : kExitFailed;
}

int run_all(const Options& options) {
  const Setup setup = load_setup();
  const Enumeration enumeration(setup, options.enumerate == "pairs");
  if (options.seed) {
    const Record record =
        run_trial(setup, enumeration.trial(*options.seed % enumeration.size()), options.verbose);
    for (const std::string& note : record.notes) fmt::print("{}\n", note);
    const auto found = check(*options.seed, record);
    for (const Finding& f : found) tell(f);
    return found.empty() ? kExitOk : kExitFailed;
  }
  const Totals totals = run_enumeration(setup, enumeration, options.campaign.threads);
  for (const Finding& f : totals.findings) {
    fmt::print("{}: {} at {:.3f} s: {}\n    fault_campaign --enumerate {} --seed {} --verbose\n",
               enumeration.name(f.seed), f.rule, to_seconds(f.when), f.what, options.enumerate,
               f.seed);
  }
  fmt::print("{}", totals.text());
  return totals.findings.empty() ? kExitOk : kExitFailed;
}

}  // namespace
}  // namespace tether::campaign

int main(int argc, char** argv) {
  using namespace tether;
  using namespace tether::campaign;
  CLI::App app(
      "Seeded runs of random faults against the vehicle's side: bridge, CAN bus, emulated drives. "
      "Exit code 1: a run broke a rule.",
      "fault_campaign");
  Options options;
  app.add_option("--runs", options.campaign.runs, "how many seeds")->capture_default_str();
  app.add_option("--first-seed", options.campaign.first_seed, "the first of them")
      ->capture_default_str();
  app.add_option("--threads", options.campaign.threads,
                 "side by side; the result does not depend on it")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  app.add_option("--seed", options.seed, "this one alone");
  app.add_flag("--verbose", options.verbose, "with --seed: the time line")->needs("--seed");
  app.add_option("--enumerate", options.enumerate,
                 "instead of seeds: each single fault, or each pair, in each phase of a drive")
      ->check(CLI::IsMember({"single", "pairs"}));
  return run_cli(app, argc, argv, [&] {
    if (!options.enumerate.empty()) return run_all(options);
    return options.seed ? run_one(options) : run_many(options);
  });
}
