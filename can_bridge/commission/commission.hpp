#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/commission/position_poll.hpp"
#include "can_bridge/commission/readings.hpp"
#include "can_bridge/commission/record.hpp"
#include "can_bridge/commission/trials.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "common/base/time.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// Tries what stops a vehicle, instead of reading that it is configured: drives both wheels slowly,
/// to and fro, and measures what each drive does (Trial). A drive that acknowledges a watchdog and
/// ignores it drives on here, at a harmless speed, and is detected.
///
/// Each trial starts the drives up with the bridge's own profile, drives at `speed_mps` for
/// kSteady, and acts. While something is withheld, all other frames go on as they were, and the
/// wheels are followed by SDO. Then the drives are stopped by all means of the profile; if they are
/// not known to stand after kMostStop, their power is cut ("disable voltage" by SDO). Nothing is
/// tried any more if the feedback is wrong, if wheels do not stop, or after abort(). A vendor's
/// watchdog may take any frame for the bridge, SDO as well: while nothing is sent, such a drive is
/// asked only after kQuiet whether it stands.
///
/// Problems: feedback that differs by more than kMostApart; a drive that is not at rest kMostWait
/// after it was left without anything, without the heartbeat that it watches, or without the
/// setpoints whose deadline the file requires; a quick stop that, with wheels free, is weaker than
/// half of the configured deceleration (0x6085). Without SYNC a drive that takes its setpoints at
/// SYNC must stop or fall silent: one that drives on and goes on to report would look healthy to
/// the bridge, and take no stop by PDO.
///
/// No I/O and no clock: frames and time in, frames out.
class Commission {
 public:
  struct Options {
    bool wheels_free = false;
    double speed_mps = 0.05;
    Duration cycle = std::chrono::milliseconds{20};
  };
  static constexpr Duration kListen = std::chrono::milliseconds{700};
  static constexpr Duration kSteady = std::chrono::milliseconds{1500};
  static constexpr Duration kMostWait = std::chrono::seconds{3};
  static constexpr Duration kQuiet = std::chrono::milliseconds{1500};
  static constexpr Duration kMostStart = std::chrono::seconds{40};
  static constexpr Duration kMostStop = std::chrono::seconds{10};
  static constexpr double kMostApart = 0.1;
  static constexpr double kMostSpeedOnFloor_mps = 0.05;
  static constexpr double kMostSpeedFree_mps = 0.5;

  /// `config` must outlive it.
  Commission(const Cia402Config& config, const VehicleConfig& vehicle, const Options& options,
             Instant now);

  std::vector<CanFilter> filters() const;
  void on_frame(const CanFrame& frame, Instant now);
  /// Once per cycle; appends the frames to send.
  void tick(Instant now, std::vector<CanFrame>& out);
  /// Stops the drives and ends.
  void abort();

  bool done() const { return step_ == Step::done; }
  /// Whether a non-zero setpoint may leave.
  bool may_move() const;
  /// Present activity, for people: "right drive …", "heartbeat withheld: driving".
  std::string progress() const;
  /// Why it could not be finished; "" if it was.
  const std::string& failure() const { return failure_; }
  /// Results, settings and objects so far; what only people know is for the caller to fill in.
  const CommissionRecord& record() const { return record_; }

 private:
  enum class Step {
    listening,
    starting,
    reading,
    enabling,
    driving,
    acting,
    stopping,
    cutting,
    done
  };

  void enter(Step step, Instant now);
  void fail(const std::string& why, Instant now);
  void begin_trial(Instant now);
  void start(Instant now);
  void read(Instant now, std::vector<CanFrame>& out);
  void enable(Instant now);
  void drive(Instant now);
  void act(Instant now, std::vector<CanFrame>& out);
  void stop(Instant now);
  void cut_power(Instant now, std::vector<CanFrame>& out);
  void withhold(Instant now, std::vector<CanFrame>& out);
  bool is_withheld(const CanFrame& frame) const;
  void run_profile(Instant now, std::vector<CanFrame>& out);

  void judge_feedback(Instant now);
  void judge_quick_stop(Instant now);
  void judge_withheld(Instant now);
  bool must_stop(std::size_t axis) const;
  bool hears_any_frame(std::size_t axis) const;
  bool waits_for_sync(std::uint8_t node) const;
  void note_feedback(const CanFrame& frame, Instant now);
  void add(std::size_t axis, const std::string& found, const std::string& problem);

  Trial trial() const { return kTrials[trial_]; }
  bool withholds() const { return trial() != Trial::feedback && trial() != Trial::quick_stop; }
  double direction() const { return trial_ % 2 == 0 ? 1.0 : -1.0; }
  Duration elapsed(Instant now) const { return now - since_; }
  double way_m(std::size_t axis) const;

  const Cia402Config& config_;
  VehicleConfig vehicle_;
  Options options_;
  CommissionRecord record_;
  std::string failure_;

  Step step_ = Step::listening;
  Instant since_;
  std::size_t trial_ = 0;
  int resets_ = 0;
  std::unique_ptr<DriveProfile> profile_;
  DrivetrainSnapshot snapshot_;
  std::optional<ObjectReader> reader_;
  std::vector<PositionPoll> polls_;
  std::array<bool, 2> reports_{};   ///< TPDOs go on while something is withheld
  std::vector<CanFrame> going_on_;  ///< frames that are sent while others are withheld
  // driving: from half of the time on; acting: from the beginning
  struct Mark {
    Instant stamp{};
    std::array<double, 2> way_m{};
    std::array<double, 2> speed_integral_m{};
  };
  std::optional<Mark> steady_;
  std::array<double, 2> steady_mps_{};
  std::array<std::optional<Instant>, 2> stood_;
  std::array<double, 2> integral_m_{};
  std::optional<Instant> last_tick_;
};

}  // namespace tether
