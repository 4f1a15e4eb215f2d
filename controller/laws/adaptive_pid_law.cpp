#include "controller/laws/adaptive_pid_law.hpp"

#include <cmath>
#include <fstream>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"

namespace tether {
namespace {

constexpr std::int64_t kPoses = 30;  // to estimate the PRR from: within ±0.18 in 95 %
constexpr std::size_t kDelays = 15;

TauTable read_table(const std::string& file) {
  std::ifstream in = open_input(file, "controller.tau_table", kMostTableBytes);
  return TauTable::read(in, file);
}

}  // namespace

AdaptivePidLaw::AdaptivePidLaw(const LawContext& context, TauTable table, double factor)
    : PidLaw(context.settings.get<ControllerSettings>(), context.path, context.ahead_m),
      table_(std::move(table)),
      factor_(factor),
      reception_(kPoses),
      delay_(kDelays) {}

void AdaptivePidLaw::on_pose(const SeenPose& seen) {
  reception_.add(seen.seq);
  delay_.add(seen.arrival - seen.stamp);
  tau_s_ = factor_ * table_.tau_s(reception_.ratio(), to_milliseconds(delay_.median()));
  set_look_ahead(tau_s_);
}

void AdaptivePidLaw::list_counters(CounterList& out) const {
  out.emplace_back("law.tau_ms", std::llround(tau_s_ * 1e3));
  out.emplace_back("law.prr_per_mille", std::llround(reception_.ratio() * 1e3));
  out.emplace_back("law.delay_ms", std::llround(to_milliseconds(delay_.median())));
}

LawKind pid_adaptive_law() {
  return {.name = "pid_adaptive",
          .steers_any_point = true,
          .keys = {"tau_table", "tau_factor"},
          .make = [](const LawContext& context) -> std::unique_ptr<Law> {
            const auto& settings = context.settings.get<ControllerSettings>();
            return std::make_unique<AdaptivePidLaw>(context, read_table(settings.tau_table),
                                                    settings.tau_factor);
          },
          .check =
              [](const ControllerSettings& settings, const std::string& file) {
                if (!settings.tau_table.empty()) return;
                throw UsageError(file +
                                 ": controller.law = \"pid_adaptive\" needs controller.tau_table, "
                                 "a CSV of look-aheads");
              }};
}

}  // namespace tether
