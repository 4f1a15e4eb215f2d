#include "common/node/sole_sender.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <netinet/in.h>

#include <algorithm>
#include <utility>

#include "common/base/say.hpp"

namespace tether {

bool SenderWatch::overlap(const Sender& a, const Sender& b) {
  return std::min(a.last, b.last) - std::max(a.first, b.first) >= kOverlap;
}

void SenderWatch::heard(Instant now, std::uint64_t sender) {
  if (sender == 0) return;
  std::erase_if(senders_, [now](const Sender& s) { return now - s.last > kMemory; });
  const auto known = std::find_if(senders_.begin(), senders_.end(),
                                  [sender](const Sender& s) { return s.name == sender; });
  if (known != senders_.end()) {
    known->last = now;
    return;
  }
  if (senders_.size() == kSenders) {
    senders_.erase(std::min_element(senders_.begin(), senders_.end(),
                                    [](const auto& a, const auto& b) { return a.last < b.last; }));
  }
  senders_.push_back({sender, now, now});
}

std::vector<std::uint64_t> SenderWatch::several(Instant now) const {
  std::vector<std::uint64_t> found;
  for (const Sender& a : senders_) {
    const bool at_once = std::any_of(senders_.begin(), senders_.end(), [&](const Sender& b) {
      const bool lately = now - std::min(a.last, b.last) <= kMemory;
      return &a != &b && lately && overlap(a, b);
    });
    if (at_once) found.push_back(a.name);
  }
  return found;
}

SoleSender::SoleSender(EventLoop& loop, Bus& bus, const std::vector<std::string>& channels,
                       Report report)
    : loop_(loop), report_(std::move(report)) {
  if (!report_) {
    report_ = [](const std::string& line) { say(Severity::warning, line); };
  }
  for (const std::string& channel : channels) {
    Watched& watched = channels_.emplace_back(Watched{channel, {}});
    bus.subscribe(channel, kDeepQueue,
                  [this, &watched](const Message& message) { heard(watched, message.sender); });
  }
}

void SoleSender::heard(Watched& watched, std::uint64_t sender) {
  if (sender == 0) return;
  any_named_ = true;
  watched.watch.heard(loop_.now(), sender);
  const std::string several = text(watched);
  if (!several.empty() && !watched.reported) {
    ++count_;
    report_("several programs send at the same time on " + several);
  }
  watched.reported = !several.empty();
}

std::string SoleSender::text(const Watched& watched) const {
  std::vector<std::string> names;
  for (const std::uint64_t sender : watched.watch.several(loop_.now())) {
    names.push_back(sender_name(sender));
  }
  if (names.empty()) return "";
  std::sort(names.begin(), names.end());
  return fmt::format("{}: {}", watched.channel, fmt::join(names, " and "));
}

bool SoleSender::several(std::string_view channel) const {
  return any_named_ && std::any_of(channels_.begin(), channels_.end(), [&](const Watched& watched) {
           return watched.channel == channel && !watched.watch.several(loop_.now()).empty();
         });
}

std::string SoleSender::trouble() const {
  for (const Watched& watched : channels_) {
    if (std::string several = text(watched); !several.empty()) return several;
  }
  return "";
}

void SoleSender::list(CounterList& out) const {
  if (count_ > 0) out.emplace_back("senders.several", count_);
}

std::string sender_name(std::uint64_t sender) {
  const in_addr address{static_cast<in_addr_t>(sender >> 16)};
  const int port = ntohs(static_cast<std::uint16_t>(sender));
  // On the loopback interface datagrams may have no address at all.
  if (address.s_addr == INADDR_ANY) return fmt::format("this host's port {}", port);
  return fmt::format("{}:{}", inet_ntoa(address), port);
}

}  // namespace tether
