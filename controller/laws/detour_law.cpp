#include <memory>

#include "controller/detour/detour_driver.hpp"
#include "controller/laws/law.hpp"
#include "controller/laws/tracking_law.hpp"

namespace tether {
namespace {

/// The remote driver of a vehicle that drives by itself (DetourDriver): stands by until it asks,
/// says to stand still until it is driven, then takes it around. It drives by poses alone, and only
/// while reports come: what it last heard of is no older than a second.
class DetourLaw final : public Law {
 public:
  static constexpr Duration kSilence = std::chrono::seconds{1};

  explicit DetourLaw(const LawContext& context)
      : path_(context.path),
        driver_(context.settings.get<AutonomySettings>(), context.settings.get<VehicleSettings>(),
                context.path, context.settings.get<PathSettings>().limits,
                mapped_shapes(context.settings)) {}

  void on_autonomy(const SeenAutonomy& seen) override {
    if (seen.asks && (!report_ || !report_->asks || report_->handover != seen.handover)) {
      driver_.begin();
    }
    report_ = seen;
    if (seen.asks) driver_.see(seen.arrival, seen.obstacles, seen.path_s_m);
  }

  LawOutput decide(Instant now, const SeenPose* newest) override {
    errors_ = errors_to(newest->pose, path_->at(to_seconds(now)));
    const bool drives = report_ && report_->driven && now - report_->arrival <= kSilence &&
                        now - newest->arrival <= kSilence;
    return drives ? driver_.drive(now, newest->pose) : Twist{};
  }

  LawErrors errors() const override { return errors_; }
  void list_counters(CounterList& out) const override { driver_.list(out); }

 private:
  std::shared_ptr<const ReferencePath> path_;
  DetourDriver driver_;
  std::optional<SeenAutonomy> report_;
  LawErrors errors_;
};

}  // namespace

LawKind detour_law() {
  return {.name = "detour",
          .drives_on_request = true,
          .keys = {},
          .make = [](const LawContext& context) -> std::unique_ptr<Law> {
            return std::make_unique<DetourLaw>(context);
          }};
}

}  // namespace tether
