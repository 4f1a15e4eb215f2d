#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/object_ref.hpp"
#include "common/base/time.hpp"

namespace tether {

/// Result of an SDO transfer.
struct SdoResult {
  enum class Outcome {
    done,
    aborted,    ///< by the drive, with `abort_code`
    no_answer,  ///< within the timeout, at each try
    segmented,  ///< the drive wants to send more than the 4 bytes of an expedited transfer
  };
  Outcome outcome = Outcome::done;
  std::int64_t value = 0;  ///< value of a read that is `done`
  std::uint32_t abort_code = 0;
};

/// Client of one node's SDO server (CiA 301, 7.2.4): one expedited transfer at a time, of at most
/// 4 bytes. No I/O and no clock. Nothing is sent before read() or write().
///
/// A reply counts only if its length, command, index and subindex are the pending request's; others
/// change nothing. A request without answer is sent again `retries` times; then the client aborts
/// the transfer on the bus, too, and reports `no_answer`.
class SdoClient {
 public:
  SdoClient(std::uint8_t node, Duration timeout, int retries);

  /// One of these starts a transfer; the request leaves at the next tick. Not while busy().
  void read(const ObjectRef& object);
  void write(const ObjectRef& object, std::int64_t value);

  /// Forgets a transfer and its result; sends nothing.
  void cancel();

  /// From read() or write() until take_result() has returned the result.
  bool busy() const { return state_ != State::idle; }

  /// How often the newest request has been sent.
  int tries() const { return tries_; }

  /// A frame with the identifier 0x580 + node. False if it should answer the pending request and
  /// does not: wrong length, command, index or subindex. Without a pending request: true, ignored
  /// (it may answer a tool).
  bool on_frame(const CanFrame& frame);

  /// Sends the request, or what its timeout asks for.
  void tick(Instant now, std::vector<CanFrame>& out);

  /// Once per transfer, as soon as it has ended.
  std::optional<SdoResult> take_result();

 private:
  enum class State { idle, unsent, sent, ended };

  void begin(const ObjectRef& object, bool is_write, std::int64_t value);
  void end(const SdoResult& result);
  void on_upload(const CanFrame& frame);

  std::uint8_t node_;
  Duration timeout_;
  int retries_;

  State state_ = State::idle;
  ObjectRef object_;
  bool is_write_ = false;
  std::int64_t value_ = 0;
  int tries_ = 0;
  Instant sent_at_{};
  SdoResult result_;
  std::optional<std::uint32_t> abort_due_;  // to be sent to the server at the next tick
};

}  // namespace tether
