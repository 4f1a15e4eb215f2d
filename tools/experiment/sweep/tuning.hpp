#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/scenario/loader.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/experiment/sweep/experiment.hpp"
#include "tools/experiment/sweep/grid.hpp"
#include "tools/experiment/sweep/search.hpp"
#include "tools/experiment/sweep/worth.hpp"

namespace tether {

/// A scenario key that is tuned, and within which bounds.
struct TunedKey {
  std::string key;
  double from = 0.0, to = 0.0;
  bool is_log = false;  ///< the search's steps are factors; then `from` is positive
  /// The values of a key that has no number, as TOML has them; a value here is a place in them,
  /// and equal parts of [0, 1] stand for them.
  std::vector<std::string> choices;
  std::vector<double> known;  ///< the key's value in each set that was good before
  std::string place;          ///< "tune.toml:12"

  /// Values from where the search is, numbers rounded to three significant digits, and back.
  double at(double coordinate) const;
  double coordinate_of(double value) const;
  /// A value as a scenario has it.
  std::string text(double value) const;
};

/// Condition that a law is tuned for.
struct TuningCondition {
  std::string name;
  std::vector<PlacedSetting> settings;
};

/// A law at its rates.
struct TuningLaw {
  std::string name;
  std::vector<PlacedSetting> settings;
  std::vector<TunedKey> keys;
  std::vector<std::size_t> conditions;  ///< numbers of Tuning::conditions
  /// Sets of values that its first search begins with: the start, and what was known.
  std::vector<std::vector<double>> given;
  std::vector<std::uint64_t> seeds;  ///< all of the tuning's, or the first of them
  SearchBudget budget;               ///< budget of each search
  std::size_t searches = 1;          ///< for each aim, from different places; the best counts

  /// The settings that a scenario is given with `values` of the keys (none: without them), on top
  /// of what is in `before`. Where a key has choices, what a scenario refuses with the one that is
  /// chosen is left out.
  struct Chosen {
    std::vector<PlacedSetting> settings, gains;
  };
  Chosen chosen(const ScenarioLoader& before, const std::vector<double>& values) const;
};

/// A tuning file (docs/howto/experiments.md): which laws to tune, for what, and with which effort.
struct Tuning {
  std::string name;
  std::string scenario_file, file;
  std::vector<std::string> overrides;
  std::string metric;
  WorthRule rule;
  std::vector<Aim> aims;  ///< each is searched for; at least one
  std::vector<std::uint64_t> seeds;
  /// Choices between survival and accuracy are measured with these; none: they are not.
  std::vector<std::uint64_t> front_seeds;
  std::vector<PlacedSetting> set;
  std::vector<TuningCondition> conditions;
  std::vector<TuningLaw> laws;

  /// Minimised quantity, for people.
  std::string objective(Aim aim) const;
  TuningLaw::Chosen chosen(const TuningLaw& law, const std::vector<double>& values) const;
  /// The scenario of a law under one of the conditions, with these values of its keys.
  Scenario scenario_of(const TuningLaw& law, std::size_t condition,
                       const std::vector<double>& values) const;
};

/// Reads the file and its scenario; `overrides` ("KEY=VALUE") apply on top of both. `quick`: with
/// one search, at most the file's quick_seeds and quick_evaluations. Throws UsageError that
/// names file, line, key and what is allowed, also if a bound is a value that the scenario must not
/// have.
Tuning load_tuning(const std::string& file, const std::vector<std::string>& overrides = {},
                   bool quick = false);

/// A number as a gains file has it: as the shortest text that reads as the same.
std::string number_text(double value);

}  // namespace tether
