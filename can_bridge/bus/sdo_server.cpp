#include "can_bridge/bus/sdo_server.hpp"

#include <algorithm>

namespace tether {
namespace {

using canopen::Abort;

constexpr std::uint32_t kToggleNotAlternated = 0x05030000;

ObjectRef object_of(const CanFrame& frame) {
  return {static_cast<std::uint16_t>(frame.data[1] | frame.data[2] << 8), frame.data[3], 4, false};
}

CanFrame response(std::uint8_t node, std::uint8_t command, const ObjectRef& object) {
  return CanFrame::make(canopen::kSdoResponse + node,
                        {command, static_cast<std::uint8_t>(object.index & 0xFF),
                         static_cast<std::uint8_t>(object.index >> 8), object.sub, 0, 0, 0, 0});
}

}  // namespace

std::optional<CanFrame> SdoServer::on_request(const CanFrame& frame) {
  if (frame.size != 8) return std::nullopt;
  const std::uint8_t command = frame.data[0];
  const ObjectRef object = object_of(frame);
  switch (command >> 5) {  // client command specifier
    case 1:
      reset();
      return download(frame, object);
    case 2:
      reset();
      return upload(object);
    case 3:
      return upload_segment(command);
    case 4:  // the client's own abort
      reset();
      return std::nullopt;
    default:
      reset();
      return abort(object, Abort::unknown_command);
  }
}

CanFrame SdoServer::abort(const ObjectRef& object, std::uint32_t code) {
  ++aborts_;
  reset();
  return canopen::sdo_abort(canopen::kSdoResponse + node_, object, code);
}

std::optional<Abort> SdoServer::missing(const ObjectRef& object, Handle h) const {
  if (refuses(object.index)) return refused_->code;
  if (h != ObjectDictionary::kNone) return std::nullopt;
  return dictionary_.has_index(object.index) ? Abort::no_subindex : Abort::no_object;
}

CanFrame SdoServer::download(const CanFrame& frame, const ObjectRef& object) {
  const Handle h = dictionary_.find(object.index, object.sub);
  if (const auto code = missing(object, h)) return abort(object, *code);
  const ObjectDictionary::Entry& entry = dictionary_.entry(h);
  if (entry.access == ObjectDictionary::Access::read_only) return abort(object, Abort::read_only);

  const std::uint8_t command = frame.data[0];
  const bool expedited = (command & 0x02) != 0;
  const bool size_given = (command & 0x01) != 0;
  if (!expedited) return abort(object, Abort::unknown_command);
  if (size_given && 4 - (command >> 2 & 0x03) != entry.ref.bytes) {
    return abort(object, Abort::wrong_length);
  }
  const std::int64_t value =
      canopen::read_integer(frame.data.data() + 4, entry.ref.bytes, entry.ref.is_signed);
  if (value < entry.minimum || value > entry.maximum) return abort(object, Abort::invalid_value);
  if (const auto code = write_(h, value)) return abort(object, *code);
  return response(node_, 0x60, object);
}

CanFrame SdoServer::upload(const ObjectRef& object) {
  const Handle h = dictionary_.find(object.index, object.sub);
  if (const auto code = missing(object, h)) return abort(object, *code);
  const ObjectDictionary::Entry& entry = dictionary_.entry(h);
  if (entry.ref.bytes == 0) {  // a string: segmented, with its size announced
    upload_ = h;
    uploaded_ = 0;
    toggle_ = false;
    CanFrame frame = response(node_, 0x41, object);
    canopen::write_integer(frame.data.data() + 4, 4, static_cast<std::int64_t>(entry.text.size()));
    return frame;
  }
  const auto unused = static_cast<std::uint8_t>(4 - entry.ref.bytes);
  CanFrame frame = response(node_, static_cast<std::uint8_t>(0x43 | unused << 2), object);
  canopen::write_integer(frame.data.data() + 4, entry.ref.bytes, dictionary_.value(h));
  return frame;
}

CanFrame SdoServer::upload_segment(std::uint8_t command) {
  if (upload_ == ObjectDictionary::kNone) return abort({}, Abort::unknown_command);
  const ObjectDictionary::Entry& entry = dictionary_.entry(upload_);
  const bool toggle = (command & 0x10) != 0;
  if (toggle != toggle_) return abort(entry.ref, kToggleNotAlternated);

  const std::size_t left = entry.text.size() - uploaded_;
  const std::size_t count = std::min<std::size_t>(left, 7);
  const bool last = count == left;
  const auto head =
      static_cast<std::uint8_t>((toggle ? 0x10 : 0) | (7 - count) << 1 | (last ? 1 : 0));
  CanFrame frame = CanFrame::make(canopen::kSdoResponse + node_, {head, 0, 0, 0, 0, 0, 0, 0});
  for (std::size_t i = 0; i < count; ++i) {
    frame.data[i + 1] = static_cast<std::uint8_t>(entry.text[uploaded_ + i]);
  }
  uploaded_ += count;
  toggle_ = !toggle_;
  if (last) reset();
  return frame;
}

}  // namespace tether
