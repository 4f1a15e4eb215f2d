#include "can_bridge/commission/guard.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "can_bridge/cia402/config.hpp"
#include "can_bridge/commission/trials.hpp"

namespace tether {
namespace {

constexpr const char* kComparing = "the drives are being compared with the record of commissioning";
constexpr const char* kRemedy =
    ". Put that right, or commission the vehicle again: tether can "
    "commission";

/// A trial of the drives that the record has no result of; "" if there is none.
std::string missing_trial(const Cia402Config& config, const CommissionRecord& record) {
  for (std::size_t i = 0; i < config.axes.size(); ++i) {
    for (const Trial trial : kTrials) {
      const std::string drive = cia402::axis_name(config, i);
      const bool there = std::ranges::any_of(record.results, [&](const auto& result) {
        return result.drive == drive && result.trial == trial_name(trial);
      });
      if (!there) return fmt::format("{}: {}", drive, trial_name(trial));
    }
  }
  return "";
}

std::string problems(const CommissionRecord& record) {
  std::string all;
  for (const CommissionRecord::Result& result : record.results) {
    if (result.problem.empty()) continue;
    all += fmt::format("{}{}: {}", all.empty() ? "" : "; ", result.drive, result.problem);
  }
  return all;
}

}  // namespace

CommissionGuard::CommissionGuard(const Cia402Config& config, double wheel_radius_m,
                                 std::optional<CommissionRecord> record, const std::string& why)
    : objects_(recorded_objects(config)) {
  const auto refuse = [this](const std::string& text) {
    if (final_) return;
    refusal_ = text + kRemedy;
    final_ = true;
  };
  if (!record) {
    refuse("not commissioned: " + why);
    return;
  }
  record_ = std::move(*record);
  if (const std::string found = problems(record_); !found.empty()) {
    refuse("the commissioning failed: " + found);
  }
  if (const std::string trial = missing_trial(config, record_); !trial.empty()) {
    refuse("the commissioning is not complete: " + trial);
  }
  const std::string other =
      differences(record_.settings, commissioned_settings(config, wheel_radius_m));
  if (!other.empty()) refuse("commissioned with another drivetrain file: " + other);
  if (!final_) refusal_ = kComparing;
}

void CommissionGuard::on_frame(const CanFrame& frame) {
  if (reader_) reader_->on_frame(frame);
}

void CommissionGuard::tick(Instant now, DrivePhase phase, std::vector<CanFrame>& out) {
  if (final_) return;
  if (phase == DrivePhase::starting || phase == DrivePhase::refused) {
    compared_ = false;  // whatever starts up may be another drive
    refusal_ = kComparing;
  }
  if (phase != DrivePhase::standby) reader_.reset();
  if (compared_ || phase != DrivePhase::standby) return;
  if (!reader_) reader_.emplace(objects_);
  reader_->tick(now, out);
  if (!reader_->done()) return;
  compare(*reader_);
  compared_ = true;
  reader_.reset();
}

void CommissionGuard::compare(const ObjectReader& reader) {
  if (const int node = reader.silent_node(); node != 0) {
    refusal_ =
        fmt::format("node {} does not answer: its identity is not known. Reset to ask again", node);
    return;
  }
  const std::string other = differences(record_.objects, reader.values());
  refusal_ = other.empty() ? "" : "commissioned with other drives or values: " + other + kRemedy;
}

}  // namespace tether
