// tether_env._core: episodes for Python, n at a time. What is documented is in tether_env/.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/path/kinds.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/gym/episode.hpp"

namespace py = pybind11;

namespace tether {
namespace {

using Numbers = py::array_t<double, py::array::c_style>;
using Settings = std::vector<std::string>;  ///< KEY=VALUE, as --set has it

/// An environment that is asked for what it cannot do now.
class ResetNeeded : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

Numbers numbers(const std::vector<py::ssize_t>& shape) { return Numbers(shape); }

py::list as_tuples(const std::vector<NumberSpace>& space) {
  py::list list;
  for (const NumberSpace& s : space) list.append(py::make_tuple(s.name, s.low, s.high));
  return list;
}

/// Marks that a thread is within reset or step: taken and left with the GIL, which they let go
/// between.
class InUse {
 public:
  explicit InUse(bool& flag) : flag_(flag) {
    if (flag_) {
      throw ResetNeeded(
          "another thread is in reset() or step() of this environment: each needs its own");
    }
    flag_ = true;
  }
  ~InUse() { flag_ = false; }
  InUse(const InUse&) = delete;
  InUse& operator=(const InUse&) = delete;

 private:
  bool& flag_;
};

/// Reaction of a step to a loop that is over; its reward is 0.
enum class AfterEnd : std::uint8_t { refuses, restarts, rests };

/// n loops of one scenario, each with a seed and settings of its own.
class Batch {
 public:
  Batch(std::string file, Settings settings, const std::string& action,
        std::vector<double> preview_s, std::size_t count)
      : file_(std::move(file)),
        settings_(std::move(settings)),
        episode_{action_kind(action), std::move(preview_s)},
        scenario_(load({})),
        observation_space_(observation_space(episode_)),
        action_space_(action_space(scenario_, episode_.action)),
        path_(make_path(scenario_.get<PathSettings>())),
        loops_(count) {
    check_actions(scenario_, episode_.action);
    next_seed_ = scenario_.get<RunSettings>().seed;
  }

  py::list observations() const { return as_tuples(observation_space_); }
  py::list actions() const { return as_tuples(action_space_); }

  /// Begins an episode of all loops, of each with its seed and its settings. Without seeds: those
  /// after the highest there was. Without settings: the environment's.
  py::tuple reset(std::vector<std::uint64_t> seeds, const std::vector<Settings>& settings,
                  const std::string& log) {
    const InUse one_thread(in_use_);
    {
      const py::gil_scoped_release others_run;
      std::map<Settings, Scenario> scenarios;
      scenarios.emplace(Settings{}, scenario_);
      for (const Settings& own : settings) {
        if (!scenarios.contains(own)) scenarios.emplace(own, load(own));
      }
      while (seeds.size() < loops_.size()) seeds.push_back(next_seed_ + seeds.size());
      for (std::size_t i = 0; i < loops_.size(); ++i) {
        loops_[i].scenario = scenarios.at(settings.empty() ? Settings{} : settings[i]);
        begin(loops_[i], seeds[i], log);
      }
      next_seed_ = *std::max_element(seeds.begin(), seeds.end()) + 1;
    }
    return py::make_tuple(observe(), info());
  }

  py::tuple step(const Numbers& action, AfterEnd after_end) {
    const InUse one_thread(in_use_);
    const std::size_t width = action_space_.size();
    const double* const all = check(action, after_end);
    Numbers reward = numbers({static_cast<py::ssize_t>(loops_.size())});
    py::array_t<bool> ended(static_cast<py::ssize_t>(loops_.size()));
    double* const rewards = reward.mutable_data();
    bool* const ends = ended.mutable_data();
    {
      const py::gil_scoped_release others_run;
      for (std::size_t i = 0; i < loops_.size(); ++i) {
        Loop& loop = loops_[i];
        if (loop.ended) {
          if (after_end == AfterEnd::restarts) begin(loop, next_seed_++, "");
          rewards[i] = 0.0;
        } else {
          loop.episode->step({all + i * width, width});
          loop.ended = loop.episode->is_over();
          rewards[i] = loop.episode->reward();
        }
        ends[i] = loop.ended;
      }
    }
    return py::make_tuple(observe(), reward, ended, info());
  }

  Numbers path_at(const Numbers& t_s) const {
    Numbers out = numbers({t_s.size(), 5});
    double* to = out.mutable_data();
    for (py::ssize_t i = 0; i < t_s.size(); ++i) {
      const PathPoint p = path_->at(t_s.data()[i]);
      for (const double x : {p.x_m, p.y_m, p.yaw_rad, p.v_mps, p.omega_radps}) *to++ = x;
    }
    return out;
  }

  std::string scenario() const { return to_toml(scenario_); }

 private:
  struct Loop {
    Scenario scenario;
    std::unique_ptr<Episode> episode;
    bool ended = false;  ///< its end was reported
  };

  /// `own`: over those of the environment.
  Scenario load(const Settings& own) const {
    Settings all = settings_;
    all.insert(all.end(), own.begin(), own.end());
    Scenario scenario = load_scenario(input_named(file_), all);
    if (!own.empty() && action_space(scenario, episode_.action) != action_space_) {
      throw UsageError(
          "options: settings must leave the action space as it is (controller.v.limit, "
          "controller.omega.limit, controller.horizon_s, controller.plan_step_ms)");
    }
    return scenario;
  }

  void begin(Loop& loop, std::uint64_t seed, const std::string& log) const {
    loop.scenario.get<RunSettings>().seed = seed;
    loop.episode.reset();  // and closes its log
    loop.episode = std::make_unique<Episode>(loop.scenario, episode_, log);
    loop.ended = false;
  }

  /// The actions' numbers, of all loops; those of loops that are over are not looked at.
  const double* check(const Numbers& action, AfterEnd after_end) const {
    for (const Loop& loop : loops_) {
      if (!loop.episode) throw ResetNeeded("step: no episode has begun; call reset() first");
      if (loop.ended && after_end == AfterEnd::refuses) {
        throw ResetNeeded("step: the episode is over (truncated); call reset() first");
      }
    }
    const std::size_t width = action_space_.size();
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      if (loops_[i].ended) continue;
      try {
        check_action({action.data() + i * width, width}, action_space_);
      } catch (const UsageError& error) {
        if (loops_.size() == 1) throw;
        throw UsageError("of loop " + std::to_string(i) + ": " + error.what());
      }
    }
    return action.data();
  }

  Numbers observe() {
    const std::size_t width = observation_space_.size();
    Numbers out =
        numbers({static_cast<py::ssize_t>(loops_.size()), static_cast<py::ssize_t>(width)});
    double* const to = out.mutable_data();
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      loops_[i].episode->observe({to + i * width, width});
    }
    return out;
  }

  /// Columns, one number a loop: of now; and results of those that have ended, if any has.
  py::dict info() {
    static constexpr const char* kNow[] = {"t_s", "x_m", "y_m", "yaw_rad", "pose_t_s"};
    static constexpr const char* kResults[] = {"epsilon_m", "rmse_m", "max_error_m",
                                               "wall_contact_s", "lost"};
    py::dict info;
    const auto column = [&](const char* name) {
      Numbers one = numbers({static_cast<py::ssize_t>(loops_.size())});
      info[name] = one;
      return one.mutable_data();
    };
    py::array_t<std::int64_t> seeds(static_cast<py::ssize_t>(loops_.size()));
    info["seed"] = seeds;
    double* now[std::size(kNow)];
    std::transform(std::begin(kNow), std::end(kNow), now, column);
    bool any_ended = false;
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      Episode& episode = *loops_[i].episode;
      const SeenPose seen = episode.pose();
      now[0][i] = to_seconds(episode.now());
      now[1][i] = seen.pose.x_m;
      now[2][i] = seen.pose.y_m;
      now[3][i] = seen.pose.yaw_rad;
      now[4][i] = to_seconds(seen.stamp);
      seeds.mutable_data()[i] =
          static_cast<std::int64_t>(loops_[i].scenario.get<RunSettings>().seed);
      any_ended = any_ended || loops_[i].ended;
    }
    if (!any_ended) return info;
    py::array_t<bool> ended(static_cast<py::ssize_t>(loops_.size()));
    info["ended"] = ended;
    double* results[std::size(kResults)];
    std::transform(std::begin(kResults), std::end(kResults), results, column);
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      ended.mutable_data()[i] = loops_[i].ended;
      const Metrics& m = loops_[i].episode->metrics();
      const double values[] = {m.epsilon_m(), m.rmse_m(), m.max_error_m(), m.wall_contact_s(),
                               m.lost() ? 1.0 : 0.0};
      for (std::size_t k = 0; k < std::size(values); ++k) {
        results[k][i] = loops_[i].ended ? values[k] : std::numeric_limits<double>::quiet_NaN();
      }
    }
    return info;
  }

  std::string file_;
  Settings settings_;
  EpisodeSettings episode_;
  Scenario scenario_;
  std::vector<NumberSpace> observation_space_;
  std::vector<NumberSpace> action_space_;
  std::shared_ptr<const ReferencePath> path_;
  std::vector<Loop> loops_;
  std::uint64_t next_seed_ = 0;
  bool in_use_ = false;
};

}  // namespace
}  // namespace tether

PYBIND11_MODULE(_core, m) {
  using namespace tether;
  py::register_exception<UsageError>(m, "UsageError", PyExc_ValueError);
  py::register_exception<ResetNeeded>(m, "ResetNeeded", PyExc_RuntimeError);
  py::enum_<AfterEnd>(m, "AfterEnd")
      .value("refuses", AfterEnd::refuses)
      .value("restarts", AfterEnd::restarts)
      .value("rests", AfterEnd::rests);
  py::class_<Batch>(m, "Batch")
      .def(py::init<std::string, Settings, const std::string&, std::vector<double>, std::size_t>())
      .def("observations", &Batch::observations)
      .def("actions", &Batch::actions)
      .def("reset", &Batch::reset)
      .def("step", &Batch::step, py::arg().noconvert(), py::arg())
      .def("path_at", &Batch::path_at)
      .def("scenario", &Batch::scenario);
}
