#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/sdo_upload.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/commission/record.hpp"
#include "common/base/time.hpp"

namespace tether {

/// An object of a drive that has to stay as it was commissioned.
struct RecordedObject {
  std::uint8_t node = 1;
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  std::string meaning;
};

/// Identity (0x1018) and versions of each drive, and what a stop depends on: options of stopping,
/// ramps, polarity, gear and feed, watchdogs, and each object that start-up writes.
std::vector<RecordedObject> recorded_objects(const Cia402Config& config);

/// Reads objects by SDO, all nodes at the same time, one request of a node at a time. Sends nothing
/// but upload requests. Pure: frames and time in, frames out.
class ObjectReader {
 public:
  static constexpr Duration kTimeout = std::chrono::milliseconds{300};
  static constexpr int kRetries = 2;

  explicit ObjectReader(const std::vector<RecordedObject>& objects);

  /// SDO answers (0x580 + node); others change nothing.
  void on_frame(const CanFrame& frame);
  void tick(Instant now, std::vector<CanFrame>& out);
  bool done() const;

  /// Once done: {"node 1, 0x1018:4 (serial number)", "0x000003E9"}; "absent" where a drive has no
  /// such object, "no answer" where it does not answer.
  std::vector<CommissionRecord::Item> values() const;
  /// The first node that did not answer, 0 if all did.
  std::uint8_t silent_node() const;

 private:
  struct Node {
    std::uint8_t id = 0;
    std::vector<RecordedObject> objects;
    std::vector<SdoUpload::Result> results;  // results of the first objects
    std::optional<SdoUpload> pending;
  };
  std::vector<Node> nodes_;
};

}  // namespace tether
