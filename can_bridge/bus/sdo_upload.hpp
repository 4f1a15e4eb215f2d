#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/object_ref.hpp"
#include "common/base/time.hpp"

namespace tether {

/// Reads one object of any length from a node's SDO server: expedited or segmented upload (CiA 301,
/// 7.2.4.3.5 and 7.2.4.3.6). For tools that only look: nothing but upload requests is ever sent,
/// not even an abort. No I/O and no clock.
class SdoUpload {
 public:
  struct Result {
    enum class Outcome {
      done,
      aborted,    ///< by the server, with `abort_code`
      no_answer,  ///< to a request and its repetitions
      garbled,    ///< the server broke the protocol, or sends more than kMaxBytes
    };
    Outcome outcome = Outcome::no_answer;
    std::vector<std::uint8_t> bytes;
    bool size_known = true;  ///< false: four bytes, of which the server does not say how many count
    std::uint32_t abort_code = 0;
  };
  static constexpr std::size_t kMaxBytes = 1024;

  /// A request without answer is repeated `retries` times, each `timeout` after the last; a lost
  /// segment ends the transfer, because repeating its request could skip one.
  SdoUpload(std::uint8_t node, std::uint16_t index, std::uint8_t sub, Duration timeout,
            int retries);

  /// A frame with the identifier 0x580 + node. Answers to other requests change nothing.
  void on_frame(const CanFrame& frame);
  /// Appends at most one request.
  void tick(Instant now, std::vector<CanFrame>& out);
  /// From the end of the transfer on.
  const std::optional<Result>& result() const { return result_; }

 private:
  enum class Expect { initiate, segment };

  void on_initiate(const CanFrame& frame);
  void on_segment(const CanFrame& frame);
  void end(Result::Outcome outcome) { result_ = Result{outcome, bytes_, true, 0}; }

  std::uint8_t node_;
  std::uint16_t index_;
  std::uint8_t sub_;
  Duration timeout_;
  int retries_;

  Expect expect_ = Expect::initiate;
  bool toggle_ = false;
  bool send_due_ = true;
  bool sent_ = false;
  int tries_ = 0;
  Instant sent_at_{};
  std::vector<std::uint8_t> bytes_;
  std::optional<Result> result_;
};

/// Whether a frame does nothing but read: an SDO upload request to one of the nodes 1…127.
bool is_upload_request(const CanFrame& frame);

/// The object that an SDO request begins to write (CiA 301, 7.2.4.3: initiate SDO download, or
/// block download); its size is not told. nullopt for any other frame.
std::optional<ObjectRef> written_object(const CanFrame& frame);

}  // namespace tether
