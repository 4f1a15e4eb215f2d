#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// A scenario key and what it is set to, as TOML has it.
struct KeyValue {
  std::string key;
  std::string value;

  /// The value for people and tables: a text without its quotes.
  std::string plain() const;
  bool operator==(const KeyValue&) const = default;
};

/// "channel.prr = 0.45, controller.tau_s = 2"; "all runs" without settings.
std::string settings_text(const std::vector<KeyValue>& settings);

/// One point of the grid.
struct Arm {
  std::vector<KeyValue> settings;  ///< settings of the grid's keys and names, in the file's order
  Scenario scenario;               ///< run.seed is each run's own

  std::string text() const { return settings_text(settings); }
};

/// Seeds are added, a batch at a time, until the 95 % interval of a metric's mean is narrow enough.
struct Precision {
  std::string metric;       ///< the name of one of metrics()
  double half_width = 0.0;  ///< in the metric's unit
  std::size_t most_seeds = 0;
  std::size_t batch = 20;  ///< at least 10: below that an interval says little
};

/// Arms that have, for each of these keys, one of the values (as KeyValue::plain() has it).
using Selection = std::vector<std::pair<std::string, std::vector<std::string>>>;
bool is_selected(const Selection& selection, const std::vector<KeyValue>& settings);

/// How `tether report` draws a sweep.
struct FigureChoice {
  enum class Kind : std::uint8_t { curve, heatmap, trajectories, risk_map, comparison, pareto };
  Kind kind = Kind::curve;
  std::string x;        ///< curve, heatmap, comparison: the key along the x axis; pareto: a metric
  std::string y;        ///< heatmap: the key along the y axis; others: of the series
  std::string metric;   ///< drawn quantity: metric_expression.hpp
  std::string y_label;  ///< instead of the metric's
  std::string title;
  Selection where;        ///< the arms that are drawn; all if empty
  std::string floor;      ///< comparison: the value of y whose first mean is a line for all x
  bool reversed = false;  ///< comparison: x falls to the right
  std::string x_label;    ///< comparison, curve: instead of the key
  std::string note;       ///< comparison: below, after the number of seeds
};

/// A table that `tether report` makes of a sweep, in addition to that of all arms.
struct TableChoice {
  enum class Kind : std::uint8_t {
    means,  ///< mean, interval and n, a row for each combination of the keys that are no columns
    ratio,  ///< ratio of the means of two arms on the same seeds, a row for each other combination
    limit,  ///< where along a key the mean passes a limit
  };
  Kind kind = Kind::means;
  std::string title;
  std::string metric;                ///< metric_expression.hpp
  std::vector<std::string> columns;  ///< means: the keys whose values go across
  std::string key;                   ///< ratio: which differs; limit: along which
  std::string over, under;           ///< ratio: values of `key`
  double limit = 0.0;                ///< ratio: it should be at least this; limit: that of the mean
  Selection where;                   ///< the arms that are in it; all if empty
};

/// An experiment file (docs/howto/experiments.md): which runs a sweep has.
struct Experiment {
  std::string name;
  std::vector<std::string> keys;  ///< keys of the grid
  std::vector<Arm> arms;          ///< part by part; the last axis varies fastest; never empty
  /// Seeds of every arm; with `precision`, the first that are needed.
  std::vector<std::uint64_t> seeds;
  std::optional<Precision> precision;
  /// The n-th runs of all arms have one seed, and so the same packet fates. If not, every run of
  /// the sweep has a seed of its own.
  bool common_random_numbers = true;
  /// The rows of trajectory that are kept of each run; 0: none.
  double trajectory_period_s = 0.0;
  std::optional<FigureChoice> figure;
  std::vector<TableChoice> tables;
  std::vector<std::string> overrides;  ///< overrides of the scenario, in addition to the file's own

  /// Seed of an arm's n-th run; and back: nullopt if the arm has no such seed.
  std::uint64_t seed(std::size_t arm, std::size_t n) const;
  std::optional<std::size_t> number(std::size_t arm, std::uint64_t seed) const;

 private:
  std::uint64_t stride() const;
};

/// Reads the file and its scenario; `overrides` ("KEY=VALUE") apply on top of both to keys that the
/// grid does not vary. `quick`: with no more than the file's quick_seeds. Throws UsageError that
/// names file, line, key and what is allowed.
Experiment load_experiment(const std::string& file, const std::vector<std::string>& overrides = {},
                           bool quick = false);

}  // namespace tether
