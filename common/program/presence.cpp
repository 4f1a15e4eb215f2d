#include "common/program/presence.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <utility>

#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"

namespace tether {

std::string node_of_program(std::string_view program) {
  constexpr std::string_view kPrefix = "tether-";
  if (!program.starts_with(kPrefix)) return "";
  program.remove_prefix(kPrefix.size());
  if (program == "ros2") return "controller";  // the door stands in its place
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

std::string host_name() {
  std::array<char, 256> name{};
  return gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "unknown";
}

Presence::Presence(EventLoop& loop, std::vector<Bus*> buses, const std::string& program,
                   const std::string& vehicle)
    : loop_(loop), buses_(std::move(buses)) {
  message_.program = program;
  message_.vehicle = vehicle;
  message_.host = host_name();
  message_.pid = getpid();
  const Duration period = from_seconds(to_seconds(kPresencePeriod) * loop.rate());
  loop.every(loop.now(), period, Priority::observer, [this](Instant) { publish_now(); });
}

void Presence::answer() {
  const Duration gap = from_seconds(to_seconds(kLeastGap) * loop_.rate());
  if (!published_ || loop_.now() - *published_ >= gap) publish_now();
}

void Presence::publish_now() {
  published_ = loop_.now();
  message_.utime = to_utime(*published_);
  message_.run = loop_.run_id();
  for (Bus* bus : buses_) publish(*bus, kPresenceChannel, message_);
  ++message_.seq;
}

}  // namespace tether
