#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/bus/sdo_client.hpp"
#include "can_bridge/cia402/axis.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/pdo.hpp"

namespace tether::cia402 {

/// Asks one node by SDO, again and again, whether its wheels stand, and has them stop. That works
/// in NMT pre-operational, too, where a drive tells nothing and takes no setpoint by PDO. No I/O
/// and no clock.
///
/// Read of each axis: statusword, actual velocity and position. Wheels stand when all of them do by
/// both witnesses (WheelMotion); with a power stage that is on, for half a second, because they
/// might be starting. An object whose reading the node aborts is a witness that says nothing. So is
/// a round in which a request had to be repeated: meanwhile its first answers have grown old. And
/// standstill is believed no longer than the next round should take: when the newest speed is older
/// than the one before it was, nothing is known until there is another.
///
/// Also read, unless wheels have to stop first: the node's watchdog, which start-up has set. A
/// drive that has rebooted has lost what start-up set (CiA 301, 7.2.8.2.2: power-on values), unless
/// it was stored in the drive; position() then returns nothing.
///
/// Written of each axis: its controlword, "quick stop" or "disable voltage" and nothing else, as
/// long as the newest statusword does not show that the axis obeys.
class StandstillInquiry {
 public:
  enum class Verdict {
    unknown,      ///< not enough answers yet
    silent,       ///< no answer in all tries; it is asked on
    turning,      ///< turning, by the newest answers
    standing,     ///< standing, by the newest answers
    unconfirmed,  ///< it answers, and a witness is missing or old; none says that it turns
  };
  struct Wheel {
    std::size_t axis = 0;  ///< 0 left, 1 right
    double speed_radps = 0.0;
  };
  /// A value that was read, as a TPDO would have told it.
  using News = std::vector<std::pair<PdoMap::Field, std::int64_t>>;

  /// `timeout`: after which an unanswered request is sent again, sdo_retries times.
  StandstillInquiry(const Cia402Config& config, std::uint8_t node, Duration timeout);

  /// From the beginning. `stop_first`: writes the controlwords before it asks anything.
  void begin(bool stop_first = false);
  /// A frame with the identifier 0x580 + node. False: not the reply that is waited for.
  bool on_sdo(const CanFrame& frame) { return sdo_.on_frame(frame); }
  /// `stop_words`: the controlwords of both axes, left and right.
  void tick(Instant now, const std::array<std::uint16_t, 2>& stop_words,
            std::vector<CanFrame>& out);

  Verdict verdict() const { return verdict_; }
  /// Since when no request has been answered in all tries; nullopt: the newest one was.
  const std::optional<Instant>& silent_since() const { return silent_since_; }
  /// By the newest answers, each axis brakes or has its power off.
  bool obeys() const;
  /// The present request was sent again, or the newest round ended for want of an answer.
  bool unanswered() const { return verdict_ == Verdict::silent || sdo_.tries() > 1; }
  /// The fastest wheel of the newest answers.
  const std::optional<Wheel>& fastest() const { return fastest_; }
  /// The position of this axis by the newest answers, in the drive's counts; nullopt unless the
  /// drive has not rebooted since start-up configured it.
  std::optional<std::int64_t> position(std::size_t axis) const;
  /// Values read since the last call.
  News take_news() { return std::exchange(news_, {}); }
  /// How many controlwords were written, repetitions not counted.
  std::int64_t writes() const { return writes_; }

 private:
  struct Reading {
    std::size_t axis = 0;
    std::optional<canopen::DriveState> state{};
    std::optional<double> speed_radps{};
    bool asked = false;  // the state, at least once
    bool power_off = false;
    std::optional<std::int64_t> position{};
    Axis witness;
  };
  enum class Asked { controlword, statusword, velocity, position, watchdog };
  struct Question {
    Asked asked{};
    std::size_t reading = 0;
    ObjectRef object;
  };

  void add_questions(Asked asked, const ObjectRef AxisConfig::*object);
  bool is_due(const Question& question, const std::array<std::uint16_t, 2>& stop_words) const;
  void ask(const std::array<std::uint16_t, 2>& stop_words);
  void on_result(const SdoResult& result, Instant now);
  void note(const Question& question, const SdoResult& result, Instant now);
  Reading blank(std::size_t axis) const;
  void on_statusword(Reading& reading, const SdoResult& result);
  void on_velocity(Reading& reading, const SdoResult& result, Instant now);
  void on_position(Reading& reading, const SdoResult& result, Instant now);
  void judge(Instant now);
  void on_repeat();
  void lapse(Instant now);
  bool has_to_write(const Reading& reading, std::uint16_t stop_word) const;

  Cia402Config config_;
  SdoClient sdo_;
  Duration round_;  // the longest that all answers of a round may take
  bool stop_first_ = false;
  bool asks_watchdog_ = true;  // not once that has had no answer, which says nothing of the wheels
  std::vector<Reading> readings_;    // this round's, or the last one's where not yet asked
  std::vector<Question> questions_;  // questions of a round
  std::size_t question_ = 0;         // number of the next
  std::int64_t watchdog_ = 0;        // value set by start-up
  bool repeated_ = false;            // a request of this round
  std::optional<Instant> told_;      // when the first axis' speed came last
  Duration told_after_{0};           // and how long after the one before
  bool configured_ = false;          // the drive still has it, as the newest answers say
  Verdict verdict_ = Verdict::unknown;
  std::optional<Instant> silent_since_;
  std::optional<Wheel> fastest_;
  std::optional<Instant> standing_since_;
  News news_;
  std::int64_t writes_ = 0;
};

/// Whether a drive in this state follows "quick stop": it brakes or its power stage is off.
bool obeys_quick_stop(std::optional<canopen::DriveState> state);
/// Whether the power stage is off in this state.
bool is_power_off(std::optional<canopen::DriveState> state);

}  // namespace tether::cia402
