#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/cia402/axis.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/pdo.hpp"
#include "can_bridge/cia402/standstill.hpp"

namespace tether::cia402 {

/// Notices that two sources send the same synchronous TPDO: two drives with one node id, or forged
/// feedback. A drive sends such a TPDO once at each n-th SYNC (CiA 301, 7.2.2.3, transmission types
/// 1…240), so frames are counted against SYNCs.
///
/// Each n-th SYNC permits one frame. A permit is kept until its frame comes, so that frames which
/// arrive late, after the next SYNCs, are none too many; but at most kBacklog are kept, so that
/// lost frames are no credit for ever. A frame without permit is one too many. One alone may be a
/// transmitter's own repetition, when an error hit the last bit of its frame (J. Rufino et al.,
/// Fault-tolerant broadcasts in CAN, FTCS-28, 1998), or of before counting began. Two sources are
/// told of at the kTooMany-th within kWindow SYNCs: with a second source that sends at each SYNC in
/// the third SYNC period, up to kBacklog periods later where frames were lost before; three frames
/// in kWindow SYNCs are noticed, fewer are not.
///
/// Event-driven TPDOs (254, 255) come as often as a drive likes and cannot be counted so.
class SenderCount {
 public:
  static constexpr int kBacklog = 3;
  static constexpr int kTooMany = 3;
  static constexpr std::int64_t kWindow = 50;

  /// `every`: the transmission type, n.
  explicit SenderCount(int every) : every_(every) {}

  /// The bridge sends SYNC.
  void on_sync();
  /// The TPDO has come. False: it is one too many.
  bool on_frame();
  bool two_sources() const;
  /// Restarts.
  void reset() { *this = SenderCount(every_); }

 private:
  int every_;
  std::int64_t syncs_ = 0;
  int permits_ = 0;
  std::array<std::optional<std::int64_t>, kTooMany> too_many_;  ///< at which SYNC; newest last
};

/// Both wheels' axes and the process data that they share: what was received, what is sent, and
/// which of them has braked, so that its power stage may go off.
class Axes {
 public:
  /// Throws UsageError if the PDOs do not carry what the axes need (PdoMap).
  Axes(const Cia402Config& config, double wheel_radius_m, double track_m);

  Axis& operator[](std::size_t i) { return axes_[i]; }
  const Axis& operator[](std::size_t i) const { return axes_[i]; }
  auto begin() { return axes_.begin(); }
  auto begin() const { return axes_.begin(); }
  auto end() { return axes_.end(); }
  auto end() const { return axes_.end(); }
  std::size_t size() const { return axes_.size(); }
  const PdoMap& pdos() const { return pdos_; }
  double wheel_radius_m() const { return wheel_radius_m_; }

  /// A new start: forgets what was received, but not that an axis was in_doubt().
  void begin(Instant now);

  /// A TPDO of the configuration. False: it has another length.
  bool on_feedback(const CanFrame& frame, Instant now);
  /// Values read by SDO count like those of a TPDO.
  /// Positions are witnesses of motion, but are not counted: the drive may have rebooted.
  void on_news(const StandstillInquiry::News& news, Instant now);

  // --- who sends the synchronous TPDOs
  void on_sync();
  /// One of them has come; others are not counted. False: it is one too many.
  bool count_sender(std::uint32_t id);
  bool two_sources(std::uint32_t id) const;
  /// From the next SYNC on.
  void restart_sender_count();

  // --- both axes
  bool fresh(Instant now) const { return axes_[0].fresh(now) && axes_[1].fresh(now); }
  bool standing(Instant now) const { return stands(0, now) && stands(1, now); }
  /// Axis `i` stands by both witnesses, and can have come to rest since it was last known to turn.
  bool stands(std::size_t i, Instant now) const {
    return axes_[i].standing(now) && has_rolled_out(i);
  }
  bool turning(Instant now) const { return axes_[0].turning(now) || axes_[1].turning(now); }
  /// A fresh witness says that a wheel of this node turns.
  bool turning_of(std::uint8_t node, Instant now) const;
  /// Whether the wheels of this node can have come to rest since they were last known to turn.
  bool can_have_stopped(std::uint8_t node) const;
  bool confirmed_off() const { return axes_[0].confirmed_off() && axes_[1].confirmed_off(); }
  /// Axis `i` may have power on or turn: its newest statusword since the last change of its
  /// controlword does not say that its power is off, or its newest speed does not say that it
  /// stands. Not before anything was heard of it.
  bool in_doubt(std::size_t i, Instant now) const;
  /// Whether axis `i` shows mode 3; true if no TPDO tells its mode (start-up has read it then).
  bool shows_velocity_mode(std::size_t i) const;
  /// Why the feedback of axis `i` is not fresh().
  std::string feedback_text(std::size_t i) const;

  // --- stopping
  /// From now on, each axis has to brake (again) before its power stage may go off.
  void hold() { released_ = {}; }
  void release() { released_ = {true, true}; }
  bool released(std::size_t i) const { return released_[i]; }
  /// Another sender may have switched on the axes of this node: they have to show again that they
  /// are off or stand.
  void doubt(std::uint8_t node);
  /// Until then, no standstill is believed, because feedback is known to be wrong.
  void distrust_standstill(Instant until) { standstill_from_ = until; }
  bool believes_standstill(Instant now) const { return now >= standstill_from_; }
  /// Standstill that both witnesses show after the newest controlword, and that is believed.
  bool confirmed_standing(std::size_t i, Instant now) const;
  /// Once per cycle, with the targets that are sent now: bounds how fast each wheel can still be,
  /// if both witnesses failed together. Until now the previous targets were in force. From target
  /// or feedback on, whichever is faster, it brakes no harder than the drive's own quick stop ramp,
  /// or than stops have to. Reports count up to the speed of limit_reports(), or one garbled or
  /// forged frame would deny standstill for minutes.
  void require_deceleration(double radps2);
  void limit_reports(double radps) { fastest_report_radps_ = radps; }
  void bound_speeds(Instant now, const std::array<std::int64_t, 2>& targets);
  /// From now until the next start-up, axis `i` is braked by a target of zero, because its quick
  /// stop cannot be relied on.
  void stop_by_setpoint(std::size_t i) { by_setpoint_[i] = true; }
  void stop_by_quick_stop(std::size_t i) { by_setpoint_[i] = false; }
  bool stops_by_setpoint(std::size_t i) const { return by_setpoint_[i]; }
  /// Controlword that brakes axis `i`: "quick stop"; or by setpoint, as long as the axis takes one,
  /// "enable operation" with a target of zero.
  std::uint16_t braking_controlword(std::size_t i) const;
  /// Like braking_controlword(), until the axis stands or its power stage is off; from then on
  /// "disable voltage".
  std::uint16_t stop_controlword(std::size_t i, Instant now);

  /// Commands the stop_controlword() of each axis, for drives that get it by SDO.
  std::array<std::uint16_t, 2> command_stop(Instant now);
  /// The commanded controlwords, as SDO may carry them: "quick stop" or "disable voltage".
  std::array<std::uint16_t, 2> sdo_stop_words() const;

  // --- to the drives
  /// The target velocities for `twist`. A wheel beyond its object's range scales both, so that the
  /// curvature stays.
  std::array<std::int64_t, 2> target_velocities(const Twist& twist) const;
  /// Commands `words` and `targets` and appends the RPDOs. A controlword that both axes share is
  /// the more cautious of the two.
  void send(std::array<std::uint16_t, 2> words, const std::array<std::int64_t, 2>& targets,
            std::vector<CanFrame>& out);

 private:
  std::array<std::uint16_t, 2> command(std::array<std::uint16_t, 2> words);
  bool has_rolled_out(std::size_t i) const { return rolled_out_[i]; }

  bool shares_controlword_;
  bool stops_by_setpoint_;  // by configuration
  std::array<bool, 2> by_setpoint_;
  double standstill_radps_;
  std::array<double, 2> ramps_radps2_;  // ramps of the quick stop; infinity: not known
  double fastest_report_radps_;
  std::array<double, 2> possible_radps_{};  // each wheel is no faster than this
  std::array<double, 2> targets_radps_{};   // in force since the newest bound, magnitudes
  std::array<Instant, 2> rolls_until_{Instant::min(), Instant::min()};  // by that bound
  std::array<bool, 2> rolled_out_{true, true};
  std::optional<Instant> bounded_at_;
  double wheel_radius_m_;
  double track_m_;
  std::uint16_t feedback_timeout_ms_;
  PdoMap pdos_;
  std::array<Axis, 2> axes_;                      // left, right
  std::map<std::uint32_t, SenderCount> senders_;  // senders of the synchronous TPDOs, by identifier
  std::map<std::uint32_t, int> misfits_;      // by identifier: a wrong length of its newest TPDO
  std::array<bool, 2> tells_mode_;            // by a TPDO
  std::array<bool, 2> released_{};            // braked; the power stage may go off
  std::array<bool, 2> in_doubt_unheard_{};    // where nothing was received since begin()
  Instant standstill_from_ = Instant::min();  // until then, standstill is not believed
};

}  // namespace tether::cia402
