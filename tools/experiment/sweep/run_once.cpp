#include "tools/experiment/sweep/run_once.hpp"

#include <algorithm>
#include <exception>
#include <functional>
#include <map>
#include <new>
#include <string>
#include <system_error>

#include "common/fleet/fleet.hpp"
#include "common/scenario/run_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/nodes/external_run.hpp"
#include "tools/runs/metric.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {
namespace {

/// The same run, with no more reports than are read: they change nothing but the time it takes.
Scenario with_few_reports(const Scenario& scenario, double trajectory_period_s) {
  Scenario quiet = scenario;
  const double slowest_hz = 1.0 / std::max(scenario.get<RunSettings>().duration_s, 1.0);
  quiet.get<RunSettings>().truth_rate_hz =
      trajectory_period_s > 0.0 ? 1.0 / trajectory_period_s : slowest_hz;
  quiet.get<RunSettings>().report_period_s =
      trajectory_period_s > 0.0 ? trajectory_period_s : scenario.get<RunSettings>().duration_s;
  return quiet;
}

std::vector<TrajectoryPoint> to_points(const std::vector<TrajectoryRow>& rows) {
  std::vector<TrajectoryPoint> points;
  for (const TrajectoryRow& row : rows) {
    const auto f = [](auto x) { return static_cast<float>(x); };
    points.push_back({f(row.t_s), f(row.x_m), f(row.y_m), f(row.x_ref_m), f(row.y_ref_m),
                      f(row.error_m), f(row.uplink_state), f(row.downlink_state)});
  }
  return points;
}

RunResult failed(const std::exception& error, bool is_to_be_repeated) {
  RunResult result;
  result.failure = error.what();
  result.is_to_be_repeated = is_to_be_repeated;
  return result;
}

/// `loop`: a ClosedLoop or an ExternalRun.
RunResult run_to_the_end(auto& loop, const Scenario& scenario, double trajectory_period_s) {
  const FleetObserver observer(fleet_members(scenario), loop.loop(), loop.bus());
  loop.run();
  observer.check_finite();
  if (scenario.get<ControllerSettings>().is_external()) observer.check_commands();
  const Instant end = kStart + from_seconds(scenario.get<RunSettings>().duration_s);
  RunResult result;
  std::transform(metrics().begin(), metrics().end(), result.metrics.begin(),
                 [&](const Metric& metric) { return value_of(metric, observer.vehicles(), end); });
  if (trajectory_period_s > 0.0) result.trajectory = to_points(observer.first().trajectory());
  return result;
}

}  // namespace

RunResult result_of(const std::function<RunResult()>& run) {
  try {
    return run();
  } catch (const NoResult& error) {
    return failed(error, true);
  } catch (const std::system_error& error) {
    return failed(error, true);
  } catch (const std::bad_alloc& error) {
    return failed(error, true);
  } catch (const std::exception& error) {
    return failed(error, false);
  }
}

RunResult run_once(const Scenario& scenario, double trajectory_period_s, std::size_t arm) {
  return result_of([&] {
    const Scenario quiet = with_few_reports(scenario, trajectory_period_s);
    if (const std::string& command = scenario.get<ControllerSettings>().command; !command.empty()) {
      thread_local std::map<std::string, ExternalController> controllers;  // by command
      ExternalRun run(quiet, controllers[command], arm);
      return run_to_the_end(run, quiet, trajectory_period_s);
    }
    ClosedLoop loop(quiet);
    return run_to_the_end(loop, quiet, trajectory_period_s);
  });
}

}  // namespace tether
