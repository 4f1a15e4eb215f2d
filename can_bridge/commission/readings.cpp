#include "can_bridge/commission/readings.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"

namespace tether {
namespace {

using Outcome = SdoUpload::Result::Outcome;

struct Known {
  std::uint16_t index;
  std::uint8_t sub;
  const char* meaning;
};

constexpr std::array kOfEachDrive{
    Known{0x1018, 1, "vendor"},
    Known{0x1018, 2, "product code"},
    Known{0x1018, 3, "revision"},
    Known{0x1018, 4, "serial number"},
    Known{0x1009, 0, "hardware version"},
    Known{0x100A, 0, "firmware version"},
    Known{0x1016, 1, "heartbeat consumer"},
    Known{0x1029, 1, "on communication error"},
    Known{0x1400, 5, "deadline of setpoints"},
    Known{0x6007, 0, "reaction to a lost master"},
    Known{0x605A, 0, "quick stop option"},
    Known{0x605B, 0, "shutdown option"},
    Known{0x605C, 0, "disable operation option"},
    Known{0x605D, 0, "halt option"},
    Known{0x605E, 0, "fault reaction option"},
    Known{0x607E, 0, "polarity"},
    Known{0x6084, 0, "profile deceleration"},
    Known{0x6085, 0, "quick stop deceleration"},
    Known{0x608F, 1, "encoder increments"},
    Known{0x608F, 2, "motor revolutions"},
    Known{0x6091, 1, "gear: motor"},
    Known{0x6091, 2, "gear: shaft"},
    Known{0x6092, 1, "feed"},
    Known{0x6092, 2, "feed: shaft"},
};

bool is_absent(std::uint32_t abort_code) {
  return abort_code == static_cast<std::uint32_t>(canopen::Abort::no_object) ||
         abort_code == static_cast<std::uint32_t>(canopen::Abort::no_subindex);
}

std::string value_text(const SdoUpload::Result& result) {
  if (result.outcome == Outcome::no_answer) return "no answer";
  if (result.outcome == Outcome::garbled) return "garbled";
  if (result.outcome == Outcome::aborted) {
    return is_absent(result.abort_code) ? "absent" : fmt::format("0x{:08X}", result.abort_code);
  }
  const std::vector<std::uint8_t>& bytes = result.bytes;
  if (bytes.empty()) return "empty";
  const auto size = static_cast<std::uint8_t>(std::min<std::size_t>(bytes.size(), 255));
  if (size <= 4) {
    return fmt::format("0x{:0{}X}", canopen::read_integer(bytes.data(), size, false), 2 * size);
  }
  const bool is_text = std::ranges::all_of(bytes, [](int c) { return c >= 0x20 && c < 0x7F; });
  if (is_text) return {bytes.begin(), bytes.end()};
  return fmt::format("{:02x}", fmt::join(bytes, ""));
}

}  // namespace

std::vector<RecordedObject> recorded_objects(const Cia402Config& config) {
  std::vector<RecordedObject> all;
  const auto add = [&all](std::uint8_t node, std::uint16_t index, std::uint8_t sub,
                          const std::string& meaning) {
    const bool known = std::ranges::any_of(all, [&](const RecordedObject& o) {
      return o.node == node && o.index == index && o.sub == sub;
    });
    if (!known) all.push_back({node, index, sub, meaning});
  };
  for (const std::uint8_t node : config.nodes()) {
    for (const Known& o : kOfEachDrive) add(node, o.index, o.sub, o.meaning);
  }
  for (const SetupWrite& write : config.setup) {
    add(write.node, write.object.index, write.object.sub, write.meaning);
  }
  for (const WatchdogConfig& watchdog : config.watchdogs) {
    add(watchdog.node, watchdog.object.index, watchdog.object.sub, "watchdog");
    if (!watchdog.reaction) continue;
    add(watchdog.node, watchdog.reaction->index, watchdog.reaction->sub, "watchdog's reaction");
  }
  return all;
}

ObjectReader::ObjectReader(const std::vector<RecordedObject>& objects) {
  for (const RecordedObject& object : objects) {
    auto node = std::ranges::find(nodes_, object.node, &Node::id);
    if (node == nodes_.end()) node = nodes_.insert(nodes_.end(), Node{object.node, {}, {}, {}});
    node->objects.push_back(object);
  }
}

void ObjectReader::on_frame(const CanFrame& frame) {
  for (Node& node : nodes_) {
    if (frame.id == canopen::kSdoResponse + node.id && node.pending) node.pending->on_frame(frame);
  }
}

void ObjectReader::tick(Instant now, std::vector<CanFrame>& out) {
  for (Node& node : nodes_) {
    if (node.pending && node.pending->result()) {
      node.results.push_back(*node.pending->result());
      node.pending.reset();
    }
    if (node.results.size() == node.objects.size()) continue;
    if (!node.pending) {
      const RecordedObject& next = node.objects[node.results.size()];
      node.pending.emplace(node.id, next.index, next.sub, kTimeout, kRetries);
    }
    node.pending->tick(now, out);
  }
}

bool ObjectReader::done() const {
  return std::ranges::all_of(
      nodes_, [](const Node& node) { return node.results.size() == node.objects.size(); });
}

std::vector<CommissionRecord::Item> ObjectReader::values() const {
  std::vector<CommissionRecord::Item> all;
  for (const Node& node : nodes_) {
    for (std::size_t i = 0; i < node.results.size(); ++i) {
      const RecordedObject& o = node.objects[i];
      const ObjectRef object{o.index, o.sub, 0, false};
      all.push_back({fmt::format("node {}, {}", node.id, cia402::object_text(object, o.meaning)),
                     value_text(node.results[i])});
    }
  }
  return all;
}

std::uint8_t ObjectReader::silent_node() const {
  const auto is_silent = [](const SdoUpload::Result& r) { return r.outcome == Outcome::no_answer; };
  const auto found = std::ranges::find_if(
      nodes_, [&](const Node& node) { return std::ranges::any_of(node.results, is_silent); });
  return found == nodes_.end() ? std::uint8_t{0} : found->id;
}

}  // namespace tether
