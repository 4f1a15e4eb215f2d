#include "can_bridge/bus/sdo_client.hpp"

#include <algorithm>
#include <cassert>

#include "can_bridge/bus/canopen.hpp"

namespace tether {
namespace {

// Server command specifiers: the upper three bits of byte 0 (CiA 301, 7.2.4.3).
constexpr int kUploadReply = 2;
constexpr int kDownloadReply = 3;
constexpr std::uint8_t kAbort = 0x80;
constexpr std::uint8_t kExpedited = 0x02;
constexpr std::uint8_t kSizeIndicated = 0x01;

}  // namespace

SdoClient::SdoClient(std::uint8_t node, Duration timeout, int retries)
    : node_(node), timeout_(timeout), retries_(retries) {}

void SdoClient::read(const ObjectRef& object) { begin(object, false, 0); }

void SdoClient::write(const ObjectRef& object, std::int64_t value) { begin(object, true, value); }

void SdoClient::begin(const ObjectRef& object, bool is_write, std::int64_t value) {
  assert(state_ == State::idle);
  object_ = object;
  is_write_ = is_write;
  value_ = value;
  tries_ = 0;
  state_ = State::unsent;
}

void SdoClient::cancel() {
  state_ = State::idle;
  abort_due_.reset();
}

void SdoClient::end(const SdoResult& result) {
  result_ = result;
  state_ = State::ended;
}

bool SdoClient::on_frame(const CanFrame& frame) {
  if (state_ != State::sent) return true;
  if (frame.size != 8) return false;
  const int index = frame.data[1] | frame.data[2] << 8;
  if (index != object_.index || frame.data[3] != object_.sub) return false;
  if (frame.data[0] == kAbort) {
    const auto code =
        static_cast<std::uint32_t>(canopen::read_integer(frame.data.data() + 4, 4, false));
    end({SdoResult::Outcome::aborted, 0, code});
    return true;
  }
  const int command = frame.data[0] >> 5;
  if (command != (is_write_ ? kDownloadReply : kUploadReply)) return false;
  if (is_write_) {
    end({SdoResult::Outcome::done, value_, 0});
  } else {
    on_upload(frame);
  }
  return true;
}

void SdoClient::on_upload(const CanFrame& frame) {
  const std::uint8_t command = frame.data[0];
  if ((command & kExpedited) == 0) {
    abort_due_ = static_cast<std::uint32_t>(canopen::Abort::unknown_command);
    end({SdoResult::Outcome::segmented, 0, 0});
    return;
  }
  // Some drives always say 4 bytes, whatever the object's size: then its own size counts.
  std::uint8_t bytes = object_.bytes;
  if ((command & kSizeIndicated) != 0) {
    bytes = std::min(bytes, static_cast<std::uint8_t>(4 - (command >> 2 & 3)));
  }
  end({SdoResult::Outcome::done,
       canopen::read_integer(frame.data.data() + 4, bytes, object_.is_signed), 0});
}

void SdoClient::tick(Instant now, std::vector<CanFrame>& out) {
  if (state_ == State::sent && now - sent_at_ >= timeout_) {
    if (tries_ <= retries_) {
      state_ = State::unsent;
    } else {
      abort_due_ = static_cast<std::uint32_t>(canopen::Abort::timeout);
      end({SdoResult::Outcome::no_answer, 0, 0});
    }
  }
  if (abort_due_) {
    out.push_back(canopen::sdo_abort(canopen::kSdoRequest + node_, object_, *abort_due_));
    abort_due_.reset();
  }
  if (state_ == State::unsent) {
    out.push_back(is_write_ ? canopen::sdo_download(node_, object_, value_)
                            : canopen::sdo_upload(node_, object_));
    ++tries_;
    sent_at_ = now;
    state_ = State::sent;
  }
}

std::optional<SdoResult> SdoClient::take_result() {
  if (state_ != State::ended) return std::nullopt;
  state_ = State::idle;
  return result_;
}

}  // namespace tether
