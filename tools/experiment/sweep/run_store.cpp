#include "tools/experiment/sweep/run_store.hpp"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/fnv1a.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"
#include "common/scenario/key_table.hpp"
#include "tools/base/json.hpp"
#include "tools/experiment/sweep/database.hpp"
#include "tools/experiment/sweep/figure_choice.hpp"
#include "tools/experiment/sweep/identity.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

/// Which of metrics() a database has, in their order: those of older versions lack newer ones.
using MetricColumns = std::vector<bool>;

/// Checksum of a row's fields, in the table's order: each with its length, so that none runs into
/// the next.
class RowSum {
 public:
  RowSum& add(std::string_view text);
  RowSum& add(std::span<const std::uint8_t> bytes);
  RowSum& add(std::int64_t value);
  /// SQLite's integers are signed.
  std::int64_t value() const;

 private:
  std::string bytes_;
};

MetricColumns metric_columns_of(const Database& database) {
  std::set<std::string> columns;
  Statement all(database, "SELECT name FROM pragma_table_info('runs')");
  while (all.step()) columns.insert(all.text(0));
  MetricColumns found;
  for (const std::string& name : metric_names()) found.push_back(columns.contains(name));
  return found;
}

/// The others' names: "lost, return_s".
std::string missing_metrics(const MetricColumns& has_metric) {
  std::string names;
  for (std::size_t i = 0; i < has_metric.size(); ++i) {
    if (!has_metric[i]) names += (names.empty() ? "" : ", ") + metrics()[i].name;
  }
  return names;
}

/// ", epsilon_m, rmse_m, NULL…": all metrics, for SELECT.
std::string selected_metrics(const MetricColumns& has_metric) {
  std::string columns;
  for (std::size_t i = 0; i < has_metric.size(); ++i) {
    columns += has_metric[i] ? ", " + metrics()[i].name : ", NULL";
  }
  return columns;
}

RowSum& RowSum::add(std::string_view text) {
  bytes_ += fmt::format("{}:", text.size());
  bytes_ += text;
  return *this;
}

RowSum& RowSum::add(std::span<const std::uint8_t> bytes) {
  return add(std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

RowSum& RowSum::add(std::int64_t value) { return add(std::string_view(fmt::format("{}", value))); }

std::int64_t RowSum::value() const { return std::bit_cast<std::int64_t>(fnv1a(bytes_)); }

/// Checksum of a run's row without its trajectory.
std::int64_t sum_of(const StoredRun& run, const MetricColumns& has_metric) {
  RowSum sum;
  sum.add(static_cast<std::int64_t>(run.arm)).add(static_cast<std::int64_t>(run.seed));
  sum.add(run.result.failure);
  if (!run.result.failure.empty()) return sum.value();  // its metrics are not stored
  for (std::size_t i = 0; i < has_metric.size(); ++i) {
    if (!has_metric[i]) continue;
    const double metric = run.result.metrics[i];
    // SQLite keeps no NaN, and zero without its sign.
    sum.add(std::isnan(metric) ? std::string("none") : fmt::format("{}", metric + 0.0));
  }
  return sum.value();
}

constexpr char kFormat[] = "2";
constexpr char kFormatWithoutSums[] = "1";  // still read, unverified

std::string create_tables() {
  std::string metrics;
  for (const std::string& name : metric_names()) metrics += fmt::format(", {} REAL", name);
  return fmt::format(
      "CREATE TABLE meta(key TEXT PRIMARY KEY, value TEXT NOT NULL, sum INTEGER NOT NULL)"
      " WITHOUT ROWID;"
      "CREATE TABLE arms(arm INTEGER PRIMARY KEY, settings TEXT NOT NULL, scenario TEXT NOT NULL,"
      " sum INTEGER NOT NULL);"
      "CREATE TABLE runs(arm INTEGER, seed INTEGER, failure TEXT{}, sum INTEGER NOT NULL,"
      " PRIMARY KEY(arm, seed))"
      " WITHOUT ROWID;"
      "CREATE TABLE trajectories(arm INTEGER, seed INTEGER, points BLOB NOT NULL, sum INTEGER NOT "
      "NULL,"
      " PRIMARY KEY(arm, seed));",
      metrics);
}

std::unique_ptr<Database> open_database(const std::filesystem::path& file, Database::Mode mode) {
  if (std::filesystem::exists(file)) {
    check_input(file.string(), "the sweep's database", kMostDatabaseBytes);
  }
  try {
    return std::make_unique<Database>(file, mode);
  } catch (const std::runtime_error& error) {
    if (mode == Database::Mode::read && !std::filesystem::exists(file)) {
      throw UsageError(fmt::format("there is no sweep's database {}", file.string()));
    }
    throw UsageError(error.what());
  }
}

bool is_empty(const Database& database) {
  Statement tables(database, "SELECT count(*) FROM sqlite_master");
  tables.step();
  return tables.whole(0) == 0;
}

/// Throws unless it is a sweep's database, undamaged.
void check_is_sweep(const Database& database) {
  try {
    Statement format(database, "SELECT value FROM meta WHERE key = 'format'");
    if (!format.step()) throw std::runtime_error("no format");
    const std::string is = format.text(0);
    if (is != kFormat && is != kFormatWithoutSums) {
      throw std::runtime_error(fmt::format("format \"{}\"", printable(is, kLongestValueShown)));
    }
    Statement check(database, "PRAGMA quick_check(1)");
    if (!check.step() || check.text(0) != "ok") throw std::runtime_error(check.text(0));
  } catch (const std::runtime_error& error) {
    throw UsageError(fmt::format("{} is no sweep's database, or a damaged one: {}",
                                 database.file().string(), error.what()));
  }
}

std::string settings_json(const std::vector<KeyValue>& settings) {
  auto json = nlohmann::ordered_json::array();
  for (const auto& [key, value] : settings) json.push_back({key, value});
  return json_text(json);
}

std::vector<KeyValue> settings_of(const std::string& json) {
  std::vector<KeyValue> settings;
  for (const auto& entry : parse_json(json)) {
    settings.push_back({entry.at(0).get<std::string>(), entry.at(1).get<std::string>()});
  }
  return settings;
}

static_assert(sizeof(TrajectoryPoint) == 8 * sizeof(float));

std::span<const std::uint8_t> bytes_of(const std::vector<TrajectoryPoint>& points) {
  return {reinterpret_cast<const std::uint8_t*>(points.data()),
          points.size() * sizeof(TrajectoryPoint)};
}

std::vector<TrajectoryPoint> points_of(std::span<const std::uint8_t> bytes) {
  std::vector<TrajectoryPoint> points(bytes.size() / sizeof(TrajectoryPoint));
  if (!points.empty()) std::memcpy(points.data(), bytes.data(), bytes.size());
  return points;
}

/// Run from a row of SELECT arm, seed, failure, metrics…, points.
StoredRun stored_run(const Statement& row) {
  StoredRun run{
      static_cast<std::size_t>(row.whole(0)), static_cast<std::uint64_t>(row.whole(1)), {}};
  if (!row.is_nothing(2)) run.result.failure = row.text(2);
  for (std::size_t i = 0; i < metrics().size(); ++i) {
    const int column = static_cast<int>(3 + i);
    run.result.metrics[i] =
        row.is_nothing(column) ? std::numeric_limits<double>::quiet_NaN() : row.real(column);
  }
  run.result.trajectory = points_of(row.bytes(static_cast<int>(3 + metrics().size())));
  return run;
}

std::string row_name(const StoredRun& run) {
  return fmt::format("the run of combination {}, seed {}", run.arm, run.seed);
}

std::string select_runs(const MetricColumns& has_metric, bool with_trajectories, bool with_sums) {
  return fmt::format("SELECT arm, seed, failure{}, {}, {}, {} FROM runs {} ORDER BY arm, seed",
                     selected_metrics(has_metric), with_trajectories ? "points" : "NULL",
                     with_sums ? "runs.sum" : "NULL",
                     with_sums && with_trajectories ? "trajectories.sum" : "NULL",
                     with_trajectories ? "LEFT JOIN trajectories USING (arm, seed)" : "");
}

}  // namespace

RunStore RunStore::begin(const std::filesystem::path& file, const Experiment& experiment,
                         const Shard& shard) {
  RunStore store(open_database(file, Database::Mode::create));
  Database& database = *store.database_;
  const Identity identity = identity_of(experiment, shard);
  if (is_empty(database)) {
    std::vector<StoredArm> arms;
    for (const Arm& arm : experiment.arms) arms.push_back({arm.settings, to_toml(arm.scenario)});
    store.make(identity, arms);
  } else {
    check_is_sweep(database);
    if (!store.has_sums()) {
      throw UsageError(
          fmt::format("{} is of an older version, without checksums: it can be read, "
                      "but not gone on with; name another folder",
                      file.string()));
    }
    store.check_contents();
    if (const std::string missing = missing_metrics(metric_columns_of(database));
        !missing.empty()) {
      throw UsageError(
          fmt::format("{} is of an older version, without the metrics {}: it can be read, but not "
                      "gone on with; name another folder",
                      file.string(), missing));
    }
    check_same(store, identity);
    check_same_arms(store, experiment);
    store.write_meta({{"figure", identity.at("figure")}, {"tables", identity.at("tables")}});
    database.execute("PRAGMA journal_mode = WAL");
  }
  // A power failure may undo the last runs, never more; the death of the process undoes nothing.
  database.execute("PRAGMA synchronous = NORMAL");
  return store;
}

RunStore RunStore::begin_like(const std::filesystem::path& file, const RunStore& shard) {
  RunStore store(open_database(file, Database::Mode::create));
  Identity identity = shard.identity();
  identity["shard"] = to_text(Shard{});
  store.make(identity, shard.arms());
  return store;
}

void RunStore::make(const Identity& identity, const std::vector<StoredArm>& arms) {
  database_->execute("PRAGMA journal_mode = WAL");
  Transaction making(*database_);
  database_->execute(create_tables());
  write_meta({{"format", kFormat}, {"wall_time_s", "0"}, {"complete", "false"}});
  write_meta(identity);
  Statement insert(*database_, "INSERT INTO arms VALUES (?, ?, ?, ?)");
  for (std::size_t i = 0; i < arms.size(); ++i) {
    insert.bind(0, static_cast<std::int64_t>(i));
    const std::string settings = settings_json(arms[i].settings);
    insert.bind(1, settings).bind(2, arms[i].scenario);
    insert
        .bind(
            3,
            RowSum().add(static_cast<std::int64_t>(i)).add(settings).add(arms[i].scenario).value())
        .run();
  }
  making.commit();
}

void RunStore::write_meta(const Identity& values) {
  Statement insert(*database_, "INSERT OR REPLACE INTO meta VALUES (?, ?, ?)");
  for (const auto& [key, value] : values) {
    insert.bind(0, key).bind(1, value).bind(2, RowSum().add(key).add(value).value()).run();
  }
}

RunStore RunStore::open(const std::filesystem::path& file) {
  RunStore store(open_database(file, Database::Mode::read));
  check_is_sweep(*store.database_);
  store.check_contents();
  return store;
}

/// Checks the conditions that all readers rely on.
void RunStore::check_contents() const {
  try {
    if (!is_identifier(name())) throw std::runtime_error("a bad name");
    if (!std::isfinite(wall_time_s())) throw std::runtime_error("a bad wall time");
    identity();  // verifies all that follows
    planned_runs(), keys(), figure(), tables(), plant(), version(), shard();
    const std::size_t count = arms().size();
    Statement range(*database_, "SELECT count(*) FROM runs WHERE arm < 0 OR arm >= ?");
    range.bind(0, static_cast<std::int64_t>(count));
    if (range.step() && range.whole(0) > 0) throw std::runtime_error("runs of no combination");
    if (count == 0) throw std::runtime_error("no combinations");
    Statement points(*database_, "SELECT count(*) FROM trajectories");
    points.step();
  } catch (const std::exception& error) {
    throw UsageError(fmt::format("{} is a damaged sweep's database: {}", database_->file().string(),
                                 error.what()));
  }
}

void RunStore::add(const std::vector<StoredRun>& runs) {
  Transaction adding(*database_);
  const MetricColumns all(metrics().size(), true);
  std::string places = "?, ?, ?, ?";
  for (std::size_t i = 0; i < metrics().size(); ++i) places += ", ?";
  Statement insert(*database_, fmt::format("INSERT INTO runs VALUES ({})", places));
  Statement insert_points(*database_, "INSERT INTO trajectories VALUES (?, ?, ?, ?)");
  for (const auto& [arm, seed, result] : runs) {
    const auto arm_number = static_cast<std::int64_t>(arm);
    const auto seed_number = static_cast<std::int64_t>(seed);
    insert.bind(0, arm_number).bind(1, seed_number);
    if (result.failure.empty()) {
      for (std::size_t i = 0; i < metrics().size(); ++i) {
        insert.bind(static_cast<int>(3 + i), result.metrics[i]);
      }
    } else {
      insert.bind(2, result.failure);
    }
    insert.bind(static_cast<int>(3 + metrics().size()), sum_of({arm, seed, result}, all));
    insert.run();
    if (result.trajectory.empty()) continue;
    insert_points.bind(0, arm_number).bind(1, seed_number);
    const auto points = bytes_of(result.trajectory);
    insert_points.bind_bytes(2, points);
    insert_points.bind(3, RowSum().add(arm_number).add(seed_number).add(points).value()).run();
  }
  adding.commit();
}

void RunStore::for_each(const std::function<void(const StoredRun&)>& use,
                        bool with_trajectories) const {
  const MetricColumns has_metric = metric_columns_of(*database_);
  Statement rows(*database_, select_runs(has_metric, with_trajectories, has_sums()));
  const int sum = static_cast<int>(4 + metrics().size());
  const Identity all = with_trajectories ? identity() : Identity{};
  const auto period = all.find("trajectory_period_s");
  const bool has_trajectories = period != all.end() && period->second != "0";
  while (rows.step()) {
    const StoredRun run = stored_run(rows);
    if (has_sums()) {
      verify(row_name(run), rows.whole(sum), sum_of(run, has_metric));
      if (with_trajectories && !rows.is_nothing(sum - 1)) {
        verify("the trajectory of " + row_name(run), rows.whole(sum + 1),
               RowSum().add(rows.whole(0)).add(rows.whole(1)).add(rows.bytes(sum - 1)).value());
      } else if (has_trajectories && run.result.failure.empty()) {
        throw UsageError(
            fmt::format("{}: the trajectory of {} is missing: take a copy, or delete "
                        "the file and repeat the sweep",
                        file().string(), row_name(run)));
      }
    }
    use(run);
  }
}

std::size_t RunStore::size() const {
  Statement count(*database_, "SELECT count(*) FROM runs");
  count.step();
  return static_cast<std::size_t>(count.whole(0));
}

std::size_t RunStore::failures() const {
  Statement count(*database_, "SELECT count(*) FROM runs WHERE failure IS NOT NULL");
  count.step();
  return static_cast<std::size_t>(count.whole(0));
}

std::optional<FailedRun> RunStore::first_failure() const {
  Statement first(*database_,
                  "SELECT arm, seed, failure FROM runs WHERE failure IS NOT NULL "
                  "ORDER BY arm, seed LIMIT 1");
  if (!first.step()) return std::nullopt;
  return FailedRun{static_cast<std::size_t>(first.whole(0)),
                   static_cast<std::uint64_t>(first.whole(1)), first.text(2)};
}

void RunStore::flush() {
  // Without a log: a reader would create its files again, and may not remove them.
  database_->execute("PRAGMA busy_timeout = 1000");
  Statement alone(*database_, "PRAGMA journal_mode = DELETE");
  if (alone.step() && alone.text(0) == "delete") return;
  throw std::runtime_error(
      fmt::format("{}: its write-ahead log is in use by another process", file().string()));
}

void RunStore::add_wall_time(double wall_time_s) {
  write_meta({{"wall_time_s", fmt::format("{}", this->wall_time_s() + wall_time_s)}});
}

std::string RunStore::meta(const std::string& key) const {
  Statement value(*database_, "SELECT value FROM meta WHERE key = ?");
  value.bind(0, key);
  if (!value.step()) {
    throw UsageError(fmt::format("{}: no \"{}\" in it", database_->file().string(), key));
  }
  return value.text(0);
}

Identity RunStore::identity() const {
  Identity identity;
  Statement rows(*database_, fmt::format("SELECT key, value{} FROM meta", sum_column()));
  while (rows.step()) {
    identity[rows.text(0)] = rows.text(1);
    if (!has_sums()) continue;
    const std::string key = printable(rows.text(0), kLongestNameShown);
    verify("meta " + key, rows.whole(2), RowSum().add(rows.text(0)).add(rows.text(1)).value());
  }
  for (const char* other : {"format", "wall_time_s", "complete"}) identity.erase(other);
  return identity;
}

bool RunStore::has_sums() const { return meta("format") != kFormatWithoutSums; }

void RunStore::verify(const std::string& row, std::int64_t stored, std::int64_t actual) const {
  if (stored == actual) return;
  throw UsageError(
      fmt::format("{}: {} does not have its checksum, so something has changed it since: take a "
                  "copy, or delete the file and repeat the sweep",
                  file().string(), row));
}

Shard RunStore::shard() const { return shard_of(meta("shard")); }

std::size_t RunStore::planned_runs() const { return std::stoul(meta("planned_runs")); }

std::vector<std::string> RunStore::keys() const {
  return parse_json(meta("keys")).get<std::vector<std::string>>();
}

std::optional<FigureChoice> RunStore::figure() const { return figure_of(meta("figure")); }

std::vector<TableChoice> RunStore::tables() const {
  const Identity all = identity();
  const auto found = all.find("tables");  // sweeps of older versions have none
  return found == all.end() ? std::vector<TableChoice>{} : tables_of(found->second);
}

std::vector<RunStore::StoredArm> RunStore::arms() const {
  std::vector<StoredArm> arms;
  Statement rows(*database_, fmt::format("SELECT settings, scenario, arm{} FROM arms ORDER BY arm",
                                         sum_column()));
  while (rows.step()) {
    if (has_sums()) {
      verify(fmt::format("combination {}", rows.whole(2)), rows.whole(3),
             RowSum().add(rows.whole(2)).add(rows.text(0)).add(rows.text(1)).value());
    }
    arms.push_back({settings_of(rows.text(0)), rows.text(1)});
  }
  return arms;
}

}  // namespace tether
