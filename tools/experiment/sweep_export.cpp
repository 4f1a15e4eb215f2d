#include "tools/experiment/sweep_export.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <set>

#include "common/errors.hpp"
#include "tools/experiment/figure_script.hpp"

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

/// Throws unless they are all shards of one sweep.
void check_one_sweep(const std::vector<RunStore>& stores) {
  const RunStore& first = stores.front();
  std::set<std::size_t> seen;
  for (const RunStore& store : stores) {
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
  for (std::size_t i = 1; i <= first.shard().count; ++i) {
    if (seen.contains(i)) continue;
    throw UsageError(fmt::format("shard {}/{} is missing", i, first.shard().count));
  }
}

}  // namespace

void export_runs(const RunStore& store, const std::function<void(const std::string&)>& write) {
  const auto arms = store.arms();
  std::string head = "arm";
  for (const std::string& key : store.keys()) head += "," + csv_cell(key);
  write(fmt::format("{},seed,plant,failure,{}\n", head, fmt::join(kMetricNames, ",")));
  const std::string plant = store.plant();
  store.for_each([&](const StoredRun& run) {
    std::string row = fmt::format("{}", run.arm);
    for (const KeyValue& setting : arms.at(run.arm).settings) row += "," + csv_cell(setting.value);
    row += fmt::format(",{},{},{}", run.seed, csv_cell(plant), csv_cell(run.result.failure));
    for (const double metric : run.result.metrics) {
      row += run.result.failure.empty() ? fmt::format(",{}", metric) : ",";
    }
    write(row + "\n");
  });
}

void export_means(const RunStore& store, const std::function<void(const std::string&)>& write) {
  const auto arms = store.arms();
  std::string head = "arm";
  for (const std::string& key : store.keys()) head += "," + csv_cell(key);
  write(fmt::format("{},plant,runs,failed,{}\n", head, fmt::join(kMetricNames, ",")));
  const std::string plant = store.plant();
  for (std::size_t arm = 0; arm < arms.size(); ++arm) {
    std::array<double, kMetricNames.size()> sums{};
    int runs = 0, failed = 0;
    store.for_each_of(arm, [&](const StoredRun& run) {
      if (!run.result.failure.empty()) {
        ++failed;
        return;
      }
      ++runs;
      for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += run.result.metrics[i];
    });
    std::string row = fmt::format("{}", arm);
    for (const KeyValue& setting : arms[arm].settings) row += "," + csv_cell(setting.value);
    row += fmt::format(",{},{},{}", csv_cell(plant), runs, failed);
    for (const double sum : sums) row += runs > 0 ? fmt::format(",{:.6g}", sum / runs) : ",";
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
  std::vector<RunStore> stores;
  for (const fs::path& shard : databases_of(shards)) stores.push_back(RunStore::open(shard));
  check_one_sweep(stores);
  // Under another name until it is whole.
  fs::path part = file;
  part += ".part";
  for (const char* rest : {"", "-wal", "-shm"}) fs::remove(part.string() + rest);
  {
    RunStore merged = RunStore::begin_like(part, stores.front());
    for (const RunStore& store : stores) {
      constexpr std::size_t kAtOnce = 1000;
      std::vector<StoredRun> runs;
      const auto flush = [&] {
        merged.add(runs);
        runs.clear();
      };
      store.for_each(
          [&](const StoredRun& run) {
            runs.push_back(run);
            if (runs.size() == kAtOnce) flush();
          },
          true);
      flush();
      merged.add_session(store.wall_time_s());
    }
    merged.set_complete();
  }
  fs::rename(part, file);
}

}  // namespace tether
