#include "tools/experiment/sweep/export.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "common/base/errors.hpp"
#include "tools/experiment/figures/figure_script.hpp"
#include "tools/experiment/statistics/statistics.hpp"
#include "tools/experiment/statistics/survival.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> databases_of(const std::vector<fs::path>& given) {
  std::vector<fs::path> files;
  for (const fs::path& path : given) {
    if (!fs::is_directory(path)) {
      files.push_back(path);
      continue;
    }
    const std::size_t before = files.size();
    for (const auto& entry : fs::directory_iterator(path)) {
      const std::string name = entry.path().filename().string();
      if (name.starts_with("shard-") && name.ends_with(".sqlite")) files.push_back(entry.path());
    }
    if (files.size() == before) {
      throw UsageError(fmt::format("no shard-*.sqlite in {}", path.string()));
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// Throws unless `store` is another whole shard of the sweep that `first` is one of.
void check_goes_with(const RunStore& first, const RunStore& store, std::set<std::size_t>& seen) {
  Identity as_first = first.identity();
  as_first["shard"] = to_text(store.shard());
  check_same(store, as_first);
  if (store.arms() != first.arms()) {
    throw UsageError(fmt::format("{} and {} are of different sweeps: their grids differ",
                                 first.file().string(), store.file().string()));
  }
  if (store.shard().count != first.shard().count || !seen.insert(store.shard().index).second) {
    throw UsageError(fmt::format("{} is shard {}, which does not go with {}, shard {}",
                                 store.file().string(), to_text(store.shard()),
                                 first.file().string(), to_text(first.shard())));
  }
  if (!store.is_complete()) {
    throw UsageError(
        fmt::format("{} is not complete: it has {} runs so far. Run its `tether "
                    "sweep --shard {}` to its end",
                    store.file().string(), store.size(), to_text(store.shard())));
  }
}

/// One is open at a time in addition to the first: there may be more shards than a process may have
/// files.
void check_one_sweep(const RunStore& first, const std::vector<fs::path>& shards) {
  std::set<std::size_t> seen;
  for (const fs::path& shard : shards) check_goes_with(first, RunStore::open(shard), seen);
  for (std::size_t i = 1; i <= first.shard().count; ++i) {
    if (seen.contains(i)) continue;
    throw UsageError(fmt::format("shard {}/{} is missing", i, first.shard().count));
  }
}

void copy_runs(const RunStore& from, RunStore& to) {
  constexpr std::size_t kAtOnce = 1000;
  std::vector<StoredRun> runs;
  const auto flush = [&] {
    to.add(runs);
    runs.clear();
  };
  from.for_each(
      [&](const StoredRun& run) {
        runs.push_back(run);
        if (runs.size() == kAtOnce) flush();
      },
      true);
  flush();
}

/// Plant of a resolved scenario.
std::string plant_of(const std::string& scenario) {
  return toml::parse(scenario)["vehicle"]["plant"].value_or(std::string("?"));
}

/// Interval of the share of ones among zeros and ones, exact as in reports; NaN: the run failed.
Interval share_interval(const std::vector<double>& values) {
  std::size_t count = 0, n = 0;
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    ++n;
    count += value > 0.5 ? 1 : 0;
  }
  return share_of(count, n, kConfidence).interval;
}

}  // namespace

void export_runs(const RunStore& store, const std::function<void(const std::string&)>& write) {
  const auto arms = store.arms();
  std::string head = "arm";
  for (const std::string& key : store.keys()) head += "," + csv_cell(key);
  write(fmt::format("{},seed,plant,failure,{}\n", head, fmt::join(metric_names(), ",")));
  const std::size_t lost = *metric_number("lost"), lost_from = *metric_number("lost_from_s");
  std::vector<std::string> plants;
  for (const auto& arm : arms) plants.push_back(plant_of(arm.scenario));
  store.for_each([&](const StoredRun& run) {
    std::string row = fmt::format("{}", run.arm);
    for (const KeyValue& setting : arms.at(run.arm).settings) {
      row += "," + csv_cell(setting.plain());
    }
    row += fmt::format(",{},{},{}", run.seed, csv_cell(plants.at(run.arm)),
                       csv_cell(run.result.failure));
    for (std::size_t i = 0; i < run.result.metrics.size(); ++i) {
      // A vehicle that was not lost has no time from which it was.
      const bool has_none = i == lost_from && run.result.metrics[lost] == 0.0;
      const bool told = run.result.failure.empty() && !has_none;
      row += told ? fmt::format(",{}", run.result.metrics[i]) : ",";
    }
    write(row + "\n");
  });
}

void export_means(const RunStore& store, const std::function<void(const std::string&)>& write) {
  const auto arms = store.arms();
  std::string head = "arm";
  for (const std::string& key : store.keys()) head += "," + csv_cell(key);
  head += ",plant,runs,failed";
  for (const std::string& metric : metric_names()) {
    head += fmt::format(",{0},{0}_low,{0}_high", metric);
  }
  write(head + "\n");
  std::vector<std::vector<std::vector<double>>> values(
      arms.size(), std::vector<std::vector<double>>(metrics().size()));
  store.for_each([&](const StoredRun& run) {
    for (std::size_t i = 0; i < metrics().size(); ++i) {
      values[run.arm][i].push_back(run.result.metrics[i]);
    }
  });
  const std::size_t lost = metric_number("lost").value();
  for (std::size_t arm = 0; arm < arms.size(); ++arm) {
    std::string row = fmt::format("{}", arm);
    for (const KeyValue& setting : arms[arm].settings) row += "," + csv_cell(setting.plain());
    row += "," + csv_cell(plant_of(arms[arm].scenario));
    for (std::size_t i = 0; i < metrics().size(); ++i) {
      Summary s = summarize(values[arm][i], kConfidence, kBootstrapSeed);
      if (i == lost) s.mean_interval = share_interval(values[arm][i]);
      if (i == 0) row += fmt::format(",{},{}", s.n, s.left_out);
      for (const double x : {s.mean, s.mean_interval.low, s.mean_interval.high}) {
        row += std::isfinite(x) ? fmt::format(",{:.6g}", x) : ",";
      }
    }
    write(row + "\n");
  }
}

fs::path database_of(const fs::path& folder_or_file) {
  return fs::is_directory(folder_or_file) ? database_in(folder_or_file, Shard{}) : folder_or_file;
}

fs::path database_in(const fs::path& folder, const Shard& shard) {
  if (shard.count == 1) return folder / "runs.sqlite";
  return folder / fmt::format("shard-{}-of-{}.sqlite", shard.index, shard.count);
}

void merge_shards(const fs::path& file, const std::vector<fs::path>& shards) {
  // A log left behind would be replayed into the new database.
  for (const char* rest : {"", "-wal", "-shm"}) {
    if (!fs::exists(file.string() + rest)) continue;
    throw UsageError(fmt::format("{}{} is there already; nothing was merged", file.string(), rest));
  }
  const std::vector<fs::path> files = databases_of(shards);
  const RunStore first = RunStore::open(files.front());
  check_one_sweep(first, files);
  // Under another name until it is whole.
  fs::path part = file;
  part += ".part";
  for (const char* rest : {"", "-wal", "-shm"}) fs::remove(part.string() + rest);
  {
    RunStore merged = RunStore::begin_like(part, first);
    for (const fs::path& shard : files) {
      const RunStore store = RunStore::open(shard);
      copy_runs(store, merged);
      merged.add_wall_time(store.wall_time_s());
    }
    merged.set_complete();
    merged.flush();
  }
  fs::rename(part, file);
}

}  // namespace tether
