#pragma once

#include <array>
#include <cstdint>
#include <optional>

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

}  // namespace tether::cia402
