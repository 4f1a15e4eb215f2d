#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/bus/object_dictionary.hpp"
#include "common/base/time.hpp"

namespace tether {

/// Where the values of RPDOs go.
class RpdoReceiver {
 public:
  virtual void receive_object(ObjectDictionary::Handle h, std::int64_t value) = 0;

 protected:
  RpdoReceiver() = default;
  ~RpdoReceiver() = default;
  RpdoReceiver(const RpdoReceiver&) = default;
  RpdoReceiver& operator=(const RpdoReceiver&) = default;
};

/// The four RPDOs and four TPDOs of an emulated device (CiA 301, 7.2.2 and 7.5.2.35…38), as its
/// object dictionary describes them at each moment. To be driven only in NMT state operational.
///
/// Configuration as in real devices: the COB-ID changes only while bit 31 says "off"; a mapping
/// only while the PDO is off (else abort 0x08000022) and its entries only while their count is 0;
/// what cannot be mapped aborts with 0x06040041, more than 8 bytes with 0x06040042; switching on a
/// PDO without mapping, or with a restricted identifier, aborts with 0x06090030.
///
/// RPDOs of transmission type 0…240 act at the next SYNC, 254 and 255 at once. A frame longer than
/// its mapping is used up to there; a shorter one is ignored.
///
/// TPDOs: type 0 at the SYNC after an event, 1…240 at each n-th SYNC, 254 and 255 at an event.
/// Events are: entering operational, the event timer (x:5), and the change of a mapped value.
/// Measured values (speed, position) never rest, so their change counts only if an inhibit time
/// (x:3, 100 µs) bounds the rate.
class EmulatedPdos {
 public:
  using Handle = ObjectDictionary::Handle;

  enum class Received { not_mine, taken, too_short };

  /// `dictionary` and `receiver` must outlive this.
  EmulatedPdos(const ObjectDictionary& dictionary, RpdoReceiver& receiver);

  /// Whether a PDO parameter may get this value now; nullopt for "yes" and for other objects.
  std::optional<canopen::Abort> refuses(Handle h, std::int64_t value) const;

  /// After parameters were written: takes over what the dictionary says now.
  void reload();

  /// NMT: entering operational. Timers and counts restart.
  void start(Instant now);

  Received on_frame(const CanFrame& frame, Instant now);
  void on_sync(Instant now, std::vector<CanFrame>& out);
  /// Event-driven TPDOs that are due.
  void tick(Instant now, std::vector<CanFrame>& out);

  /// Whether an RPDO's deadline (0x1400:5, ms) passed since the last call. Its clock starts with
  /// the first frame, and a missed deadline is reported once until the next frame.
  bool deadline_missed(Instant now);

 private:
  struct Pdo {
    // Parameters
    bool transmit = false;
    Handle cob_id{}, type{}, event_timer{}, inhibit = ObjectDictionary::kNone, count{};
    std::array<Handle, 8> map{};
    // Decoded content
    bool valid = false;
    std::uint32_t id = 0;
    std::uint8_t transmission = 255;
    Duration event_time{0};
    Duration inhibit_time{0};
    std::uint8_t objects = 0;
    std::uint8_t bytes = 0;
    std::array<Handle, 8> object{};
    // Running
    CanFrame frame;        // RPDO: waits for SYNC; TPDO: the last one sent
    bool waiting = false;  // RPDO: for SYNC; TPDO: an event has come
    bool watched = false;  // RPDO: the deadline runs
    std::uint8_t syncs = 0;
    Instant last{};  // received or sent
  };

  const Pdo* owner(Handle h) const;
  std::optional<canopen::Abort> refuses_cob_id(const Pdo& pdo, std::int64_t value) const;
  std::optional<canopen::Abort> refuses_entry(const Pdo& pdo, std::int64_t value) const;
  std::optional<canopen::Abort> refuses_count(const Pdo& pdo, std::int64_t value) const;
  Handle mappable(std::int64_t entry, bool transmit) const;
  void load(Pdo& pdo);
  void deliver(const Pdo& pdo);
  void sample(const Pdo& pdo, CanFrame& frame) const;
  bool changed(const Pdo& pdo, const CanFrame& now) const;
  void send(Pdo& pdo, Instant now, std::vector<CanFrame>& out);

  const ObjectDictionary& dictionary_;
  RpdoReceiver& receiver_;
  std::array<Pdo, 4> rpdos_;
  std::array<Pdo, 4> tpdos_;
};

}  // namespace tether
