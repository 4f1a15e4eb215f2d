#pragma once

#include <gmock/gmock.h>

#include <filesystem>
#include <string>
#include <vector>

#include "netem/channel/settings.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/experiment/sweep/export.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

inline Experiment two_arms() {
  Experiment e;
  e.name = "two_arms";
  e.keys = {"channel.prr"};
  e.arms = {Arm{{{"channel.prr", "1"}}, {}}, Arm{{{"channel.prr", "0.5"}}, {}}};
  e.arms[1].scenario.get<ChannelSettings>().uplink.fixed.prr = 0.5;
  e.seeds = {1, 2};
  e.trajectory_period_s = 1.0;
  return e;
}

inline RunResult result(double epsilon_m) {
  RunResult r;
  r.metrics.assign(r.metrics.size(), 0.5);
  r.metrics[0] = epsilon_m;
  r.trajectory = {{0.0F, 1.0F, 2.0F, 3.0F, 4.0F, 5.0F, 0.0F, 1.0F}, {}};
  return r;
}

inline RunResult failure(const std::string& why) {
  RunResult r;
  r.failure = why;
  return r;
}

class Store : public ::testing::Test {
 protected:
  RunStore begin(const Experiment& experiment = two_arms(), const Shard& shard = {}) {
    return RunStore::begin(database_in(folder_, shard), experiment, shard);
  }
  static std::vector<StoredRun> runs_of(const RunStore& store) {
    std::vector<StoredRun> runs;
    store.for_each([&](const StoredRun& run) { runs.push_back(run); }, true);
    return runs;
  }
  static std::string exported(const RunStore& store) {
    std::string text;
    export_runs(store, [&text](const std::string& more) { text += more; });
    return text;
  }

  test::Folder own_;
  const std::filesystem::path& folder_ = own_.path;
  std::filesystem::path file_ = folder_ / "runs.sqlite";
};

}  // namespace tether
