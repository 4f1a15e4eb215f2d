#include <fmt/format.h>

#include <algorithm>

#include "netem/stages/coin.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

struct CorruptSettings {
  double probability = 0.0;  ///< probability that a packet is damaged
  std::int64_t bits = 1;     ///< flipped in a damaged packet, all different

  bool operator==(const CorruptSettings&) const = default;
};

/// Bit errors: damages a packet with a probability by flipping `bits` different bits of it (all of
/// them if it has fewer). Two draws per packet.
class Corruption final : public LinkStage {
 public:
  using Settings = CorruptSettings;

  Corruption(const CorruptSettings& settings, const LinkStreams& streams)
      : Corruption(settings, streams("corrupt")) {}

  void set(const CorruptSettings& settings) {
    bits_ = settings.bits;
    coin_.set(settings.probability);
  }
  void skip(std::int64_t packets) {
    coin_.skip(packets);
    where_.discard(static_cast<std::uint64_t>(packets));
  }

  void meet(OfferedPacket& offered) override {
    const std::uint64_t where = where_();
    if (!coin_.toss() || !offered.goes_on()) return;
    offered.fate.corrupted = damage(where, offered.packet.bytes);
  }

 private:
  Corruption(const CorruptSettings& settings, RandomEngine random)
      : bits_(settings.bits), coin_(settings.probability, RandomEngine{random()}), where_(random) {}

  /// `where` decides which bits. False if there was nothing to flip.
  bool damage(std::uint64_t where, std::vector<std::uint8_t>& bytes) const {
    const std::uint64_t total = 8 * bytes.size();
    const std::uint64_t wanted = std::min(total, static_cast<std::uint64_t>(bits_));
    // Floyd's sampling without replacement (Communications of the ACM 30(9), 1987).
    std::vector<bool> chosen(total);
    for (std::uint64_t i = total - wanted; i < total; ++i) {
      std::uint64_t bit = split_mix(where + i) % (i + 1);
      if (chosen[bit]) bit = i;
      chosen[bit] = true;
      bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    }
    return total > 0;
  }

  std::int64_t bits_;
  Coin coin_;
  RandomEngine where_;
};

const CorruptSettings& of(const LinkConfig& link) { return link.own.get<CorruptSettings>(); }

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<CorruptSettings>("corrupt");
  t.number("probability", &CorruptSettings::probability, kRatio,
           "probability that a packet is damaged");
  t.whole_number("bits", &CorruptSettings::bits, 1, "number of bits flipped in a damaged packet");
  return t.take();
}

void export_tc(const LinkConfig& link, const TcSender&, TcDraft& out) {
  if (of(link).probability <= 0.0) return;
  out.command += " corrupt " + tc_percent(of(link).probability);
  out.notes.push_back(fmt::format(
      "corrupt: netem flips one bit{} anywhere in the frame, headers included; the receiver's "
      "network stack drops nearly all such packets for their checksum",
      of(link).bits > 1 ? fmt::format(", not {},", of(link).bits) : ""));
}

}  // namespace

LinkStageKind corrupt_stage() {
  LinkStageKind kind{.name = "corrupt"};
  kind.on = [](const LinkConfig& link) { return of(link).probability > 0.0; };
  kind.make = [](const StageNeeds& needs) { return needs.go_on<Corruption>(); };
  kind.keys = keys;
  kind.switch_key = "corrupt.probability";
  kind.export_tc = export_tc;
  kind.tc_part = TcPart::corrupt;
  return kind;
}

}  // namespace tether
