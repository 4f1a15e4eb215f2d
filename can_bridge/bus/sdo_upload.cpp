#include "can_bridge/bus/sdo_upload.hpp"

#include "can_bridge/bus/canopen.hpp"

namespace tether {
namespace {

constexpr std::uint8_t kInitiate = 0x40;  // request, and specifier of its answer
constexpr std::uint8_t kSegment = 0x60;   // request; the answer's specifier is 0
constexpr std::uint8_t kToggle = 0x10;
constexpr std::uint8_t kAbortTransfer = 0x80;
constexpr std::uint8_t kSpecifier = 0xE0;

}  // namespace

SdoUpload::SdoUpload(std::uint8_t node, std::uint16_t index, std::uint8_t sub, Duration timeout,
                     int retries)
    : node_(node), index_(index), sub_(sub), timeout_(timeout), retries_(retries) {}

void SdoUpload::on_frame(const CanFrame& frame) {
  if (result_ || !sent_ || frame.id != canopen::kSdoResponse + node_ || frame.size != 8) return;
  const std::uint8_t command = frame.data[0];
  const bool names_object = (frame.data[1] | frame.data[2] << 8) == index_ && frame.data[3] == sub_;
  if (command == kAbortTransfer) {
    if (!names_object) return;
    end(Result::Outcome::aborted);
    result_->abort_code =
        static_cast<std::uint32_t>(canopen::read_integer(frame.data.data() + 4, 4, false));
  } else if (expect_ == Expect::initiate) {
    if (names_object && (command & kSpecifier) == kInitiate) on_initiate(frame);
  } else if ((command & kSpecifier) == 0) {
    on_segment(frame);
  }
}

void SdoUpload::on_initiate(const CanFrame& frame) {
  const std::uint8_t command = frame.data[0];
  const bool expedited = (command & 2) != 0, has_size = (command & 1) != 0;
  if (!expedited) {
    expect_ = Expect::segment;
    send_due_ = true;
    tries_ = 0;
    return;
  }
  const std::size_t size = has_size ? 4U - (command >> 2 & 3U) : 4U;
  bytes_.assign(frame.data.begin() + 4, frame.data.begin() + 4 + static_cast<int>(size));
  end(Result::Outcome::done);
  result_->size_known = has_size;
}

void SdoUpload::on_segment(const CanFrame& frame) {
  const std::uint8_t command = frame.data[0];
  if (((command & kToggle) != 0) != toggle_) return end(Result::Outcome::garbled);
  const std::size_t size = 7U - (command >> 1 & 7U);
  bytes_.insert(bytes_.end(), frame.data.begin() + 1,
                frame.data.begin() + 1 + static_cast<int>(size));
  if (bytes_.size() > kMaxBytes) return end(Result::Outcome::garbled);
  if ((command & 1) != 0) return end(Result::Outcome::done);
  toggle_ = !toggle_;
  send_due_ = true;
}

void SdoUpload::tick(Instant now, std::vector<CanFrame>& out) {
  if (result_) return;
  if (!send_due_) {
    if (now - sent_at_ < timeout_) return;
    if (expect_ == Expect::segment || tries_ > retries_) return end(Result::Outcome::no_answer);
  }
  send_due_ = false;
  sent_ = true;
  sent_at_ = now;
  ++tries_;
  if (expect_ == Expect::initiate) {
    out.push_back(canopen::sdo_upload(node_, ObjectRef{index_, sub_, 0, false}));
  } else {
    const auto command = static_cast<std::uint8_t>(kSegment | (toggle_ ? kToggle : 0));
    out.push_back(CanFrame::make(canopen::kSdoRequest + node_, {command, 0, 0, 0, 0, 0, 0, 0}));
  }
}

bool is_upload_request(const CanFrame& frame) {
  return !frame.extended && !frame.remote && frame.size == 8 && frame.id > canopen::kSdoRequest &&
         frame.id <= canopen::kSdoRequest + 127 &&
         (frame.data[0] == kInitiate || frame.data[0] == kSegment ||
          frame.data[0] == (kSegment | kToggle));
}

std::optional<ObjectRef> written_object(const CanFrame& frame) {
  // Drives may accept requests that are shorter than the standard's 8 bytes; without an object
  // there is none to write.
  if (frame.size < 4) return std::nullopt;
  const auto& d = frame.data;
  const int command = d[0] >> 5;
  constexpr int kInitiateDownload = 1, kBlockDownload = 6;
  const bool initiates =
      command == kInitiateDownload || (command == kBlockDownload && (d[0] & 1) == 0);
  if (!initiates) return std::nullopt;
  return ObjectRef{static_cast<std::uint16_t>(d[1] | d[2] << 8), d[3], 0, false};
}

}  // namespace tether
