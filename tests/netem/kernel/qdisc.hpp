#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

namespace tether::test {

/// Runs tc, of which the test needs success, and returns what it wrote.
inline std::string tc(const std::string& arguments) {
  FILE* pipe = popen(("tc " + arguments + " 2>&1").c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("cannot run tc: install iproute2");
  std::string text;
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) text += static_cast<char>(c);
  if (pclose(pipe) != 0) throw std::runtime_error("tc " + arguments + ": " + text);
  return text;
}

/// Counters of the kernel at a queueing discipline, packets.
struct QdiscCounts {
  std::int64_t sent = 0;
  std::int64_t dropped = 0;
  std::int64_t waiting = 0;
};

/// All there is on lo, by handle ("10:"): the queueing disciplines that were added last. Gone when
/// the object is.
class LoQdiscs {
 public:
  /// Refuses to touch a machine's own lo.
  LoQdiscs() {
    if (std::getenv("TETHER_CAN_KERNEL") == nullptr) {
      throw std::runtime_error(
          "wants a network of its own: run it in tests/uml/with_can.sh --netem");
    }
  }
  ~LoQdiscs() {
    if (any_) tc("qdisc del dev lo root");
  }
  LoQdiscs(const LoQdiscs&) = delete;
  LoQdiscs& operator=(const LoQdiscs&) = delete;

  /// `what` as in tc qdisc add dev lo …
  void add(const std::string& what) {
    tc("qdisc add dev lo " + what);
    any_ = true;
  }

  std::map<std::string, QdiscCounts> counts() const {
    std::map<std::string, QdiscCounts> counts;
    for (const auto& q : nlohmann::json::parse(tc("-s -j qdisc show dev lo"))) {
      counts[q.at("handle")] = {q.at("packets"), q.at("drops"), q.at("qlen")};
    }
    return counts;
  }

 private:
  bool any_ = false;
};

/// Checks that all `offered` packets that did not arrive were dropped by the queueing discipline.
inline void expect_all_accounted_for(const QdiscCounts& counts, std::int64_t offered,
                                     std::int64_t received) {
  ASSERT_EQ(counts.sent, received) << "packets were lost elsewhere than in tc's queue";
  ASSERT_EQ(counts.sent + counts.dropped, offered) << "tc's queue saw other packets, too";
  ASSERT_EQ(counts.waiting, 0);
}

}  // namespace tether::test
