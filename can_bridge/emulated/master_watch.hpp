#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/canopen/canopen.hpp"
#include "can_bridge/canopen/object_dictionary.hpp"
#include "common/base/time.hpp"

namespace tether {

/// An emulated drive's watch over its master: heartbeat consumers (0x1016, CiA 301, 7.5.2.19) and
/// vendors' watchdogs in milliseconds. How the drive reacts to a miss is decided elsewhere.
class EmulatedMasterWatch {
 public:
  using Handle = ObjectDictionary::Handle;

  /// `dictionary` must outlive this.
  EmulatedMasterWatch(const ObjectDictionary& dictionary, const std::vector<Handle>& consumers,
                      std::vector<Handle> watchdogs);

  /// Power-on: waits for the first heartbeat and the first contact.
  void reset();

  /// Whether a consumer may get this value now: (node << 16) | milliseconds; either zero: off. One
  /// producer has one consumer (else 0x06040043). nullopt for "yes" and for other objects.
  std::optional<canopen::Abort> refuses(Handle h, std::int64_t value) const;
  /// A consumer that was written waits for its first heartbeat again.
  void written(Handle h);

  /// True if this is the heartbeat of a watched producer. Its boot-up message is none.
  bool on_heartbeat(const CanFrame& frame, Instant now);
  /// True once for each producer that fell silent, until it beats again.
  bool heartbeat_missed(Instant now);

  /// For the vendor's watchdogs: an SDO request or RPDO came; and: the NMT state changed, so that
  /// they wait for the first contact again.
  void contact(Instant now);
  void wait_for_contact() { contact_ = false; }
  /// True once each time that contact was lost.
  bool watchdog_missed(Instant now);

 private:
  struct Consumer {
    Handle object{};
    bool active = false;
    Instant last{};
  };
  const ObjectDictionary& dictionary_;
  std::vector<Consumer> consumers_;
  std::vector<Handle> watchdogs_;
  bool contact_ = false;
  Instant last_contact_{};
};

}  // namespace tether
