#include "netem/stages/room.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>

#include "netem/stages/kinds.hpp"
#include "netem/stages/rate.hpp"

namespace tether {
namespace {

class Room final : public LinkStage {
 public:
  explicit Room(const RoomSettings& settings) : settings_(settings) {}

  bool pass(Passage& passage) override {
    return static_cast<std::int64_t>(passage.under_way.size()) < settings_.packets &&
           static_cast<std::int64_t>(passage.under_way.bytes() + passage.bytes) <= settings_.bytes;
  }

 private:
  RoomSettings settings_;
};

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<RoomSettings>("");
  t.whole_number("queue_limit", &RoomSettings::packets, 1,
                 "maximum number of packets under way; more are dropped and counted");
  t.whole_number("queue_limit_bytes", &RoomSettings::bytes, 1,
                 "maximum payload of packets under way; more are dropped and counted");
  return t.take();
}

/// tc's limit counts the packets that it holds, delayed ones included.
void export_tc(const LinkConfig& link, const TcSender&, TcDraft& out) {
  const auto& room = link.own.get<RoomSettings>();
  const auto& rate = link.own.get<RateSettings>();
  std::int64_t limit = std::min<std::int64_t>(room.packets, UINT32_MAX);
  if (rate.bits_per_s > 0.0) {
    // Without delay all packets in it wait for the rate.
    const bool delayed = out.has("delay");
    if (!delayed) limit = std::min(limit, rate.queue_packets);
    if (delayed) {
      out.notes.push_back(fmt::format(
          "rate.queue_packets = {} is left out: netem's limit counts delayed packets as well",
          rate.queue_packets));
    }
    if (rate.queue_bytes > 0) {
      out.notes.push_back(fmt::format(
          "rate.queue_bytes = {} is left out: netem's limit is in packets", rate.queue_bytes));
    }
  }
  out.command += fmt::format(" limit {}", limit);
}

}  // namespace

LinkStageKind room_stage() {
  LinkStageKind kind{.name = "room"};
  kind.make = [](const StageNeeds& needs) -> StagePtr {
    return std::make_unique<Room>(needs.settings<RoomSettings>());
  };
  kind.keys = keys;
  kind.switch_key = "queue_limit_bytes";
  kind.export_tc = export_tc;
  kind.tc_part = TcPart::limit;
  return kind;
}

}  // namespace tether
