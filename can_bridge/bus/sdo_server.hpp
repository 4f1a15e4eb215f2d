#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/bus/object_dictionary.hpp"

namespace tether {

/// The SDO server of a CANopen device (CiA 301, 7.2.4.3): reads and writes its object dictionary,
/// one transfer at a time.
///
/// Expedited transfers both ways, and segmented uploads for strings. Everything else (segmented and
/// block downloads, block uploads) aborts with 0x05040001. A write aborts, in this order, with
/// 0x06020000 no such object, 0x06090011 no such subindex, 0x06010002 read-only, 0x06070010 wrong
/// length, 0x06090030 value out of range, then with whatever the device itself has against it.
/// Requests that are not 8 bytes long are not answered, as the standard has it.
class SdoServer {
 public:
  using Handle = ObjectDictionary::Handle;
  /// The device's part of a write that has passed all checks here: stores the value, or says why
  /// not.
  using Write = std::function<std::optional<canopen::Abort>(Handle, std::int64_t)>;

  SdoServer(std::uint8_t node, ObjectDictionary& dictionary, Write write)
      : node_(node), dictionary_(dictionary), write_(std::move(write)) {}

  /// The answer to a request; nullopt if there is none. `frame` has this server's identifier.
  std::optional<CanFrame> on_request(const CanFrame& frame);

  /// Forgets a transfer under way.
  void reset() { upload_ = ObjectDictionary::kNone; }

  /// Answers every access to object `index` (0: to any) with `code`.
  void refuse(std::uint16_t index, canopen::Abort code) { refused_ = Refusal{index, code}; }
  void refuse_nothing() { refused_.reset(); }

  std::int64_t aborts() const { return aborts_; }

 private:
  struct Refusal {
    std::uint16_t index;
    canopen::Abort code;
  };
  CanFrame abort(const ObjectRef& object, std::uint32_t code);
  CanFrame abort(const ObjectRef& object, canopen::Abort code) {
    return abort(object, static_cast<std::uint32_t>(code));
  }
  CanFrame download(const CanFrame& frame, const ObjectRef& object);
  CanFrame upload(const ObjectRef& object);
  CanFrame upload_segment(std::uint8_t command);
  std::optional<canopen::Abort> missing(const ObjectRef& object, Handle h) const;
  bool refuses(std::uint16_t index) const {
    return refused_ && (refused_->index == 0 || refused_->index == index);
  }

  std::uint8_t node_;
  ObjectDictionary& dictionary_;
  Write write_;
  std::optional<Refusal> refused_;
  std::int64_t aborts_ = 0;
  Handle upload_ = ObjectDictionary::kNone;  // string being uploaded
  std::size_t uploaded_ = 0;
  bool toggle_ = false;
};

}  // namespace tether
