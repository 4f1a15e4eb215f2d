#include "common/program/run_senders.hpp"

#include <algorithm>
#include <utility>

#include "common/bus/channel_names.hpp"

namespace tether {

std::string node_of_program(std::string_view program) {
  constexpr std::string_view kPrefix = "tether-";
  if (!program.starts_with(kPrefix)) return "";
  program.remove_prefix(kPrefix.size());
  return std::string(program.substr(0, program.find('-')));
}

RunSenders::RunSenders(Config config, const EventLoop& loop)
    : config_(std::move(config)), loop_(loop) {}

bool RunSenders::heard(const presence_t& presence, std::uint64_t sender) {
  if (sender == 0 || presence.vehicle != config_.vehicle) return false;
  const Instant now = loop_.now();
  const Sender heard{sender, presence.program, node_of_program(presence.program), presence.run,
                     now};
  const auto known = std::find_if(senders_.begin(), senders_.end(),
                                  [sender](const Sender& s) { return s.name == sender; });
  if (known != senders_.end()) {
    *known = heard;
    return false;
  }
  if (senders_.size() == kSenders) {
    const auto oldest = std::min_element(senders_.begin(), senders_.end(),
                                         [](auto& a, auto& b) { return a.heard < b.heard; });
    if (to_seconds(now - oldest->heard) < to_seconds(kKept) * loop_.rate()) return false;
    senders_.erase(oldest);
  }
  senders_.push_back(heard);
  return true;
}

RunSenders::Owners RunSenders::owners_of(const Message& message, const std::string& node) const {
  const bool any_run = message.channel == ChannelNames::kClock;
  const double forgotten_s = to_seconds(kForgotten) * loop_.rate();
  Owners owners;
  for (const Sender& s : senders_) {
    if (s.node != node || (s.run != loop_.run_id() && !any_run)) continue;
    if (s.name == message.sender) owners.has_sender = true;
    if (to_seconds(loop_.now() - s.heard) < forgotten_s) owners.newest = &s;
  }
  return owners;
}

bool RunSenders::takes(const Message& message) const {
  if (message.sender == 0) return true;
  const auto owned = config_.owners.find(message.channel);
  if (owned == config_.owners.end()) return true;
  const std::string& node = owned->second;
  const Owners owners = owners_of(message, node);
  const auto& expected = config_.expected;
  const bool is_expected = std::find(expected.begin(), expected.end(), node) != expected.end();
  return owners.has_sender || (!is_expected && owners.newest == nullptr);
}

std::optional<std::string> RunSenders::owner_heard(const Message& message) const {
  const auto owned = config_.owners.find(message.channel);
  if (owned == config_.owners.end()) return std::nullopt;
  const Sender* owner = owners_of(message, owned->second).newest;
  return owner == nullptr ? std::nullopt : std::optional(owner->program);
}

}  // namespace tether
