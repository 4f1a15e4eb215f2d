#pragma once

#include <cstdint>
#include <string>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>
#include <vector>

#include "common/node/in_process_bus.hpp"
#include "common/node/message_io.hpp"
#include "common/node/virtual_loop.hpp"

namespace tether::test {

inline Instant at_s(double seconds) { return kStart + from_seconds(seconds); }
inline Instant at_ms(double milliseconds) { return kStart + from_seconds(milliseconds * 1e-3); }

/// A message as a test saw it, and when.
template <class LcmType>
struct Seen {
  Instant when;
  LcmType message;
};

/// Virtual time and a bus, for nodes under test.
struct VirtualWorld {
  VirtualLoop loop;
  InProcessBus bus{loop};
  std::int64_t undecodable = 0;

  /// Collects what appears on a channel; call before the loop runs.
  template <class LcmType>
  void collect(const std::string& channel, std::vector<Seen<LcmType>>& out) {
    subscribe<LcmType>(bus, channel, kDeepQueue, undecodable, [this, &out](const LcmType& m) {
      out.push_back({loop.now(), m});
    });
  }

  /// Publishes at a later time.
  template <class LcmType>
  void publish_at(Instant when, const std::string& channel, const LcmType& message) {
    loop.at(when, Priority::node,
            [this, channel, message](Instant) { publish(bus, channel, message); });
  }
  void publish_bytes_at(Instant when, const std::string& channel, std::vector<std::uint8_t> bytes) {
    loop.at(when, Priority::node,
            [this, channel, bytes = std::move(bytes)](Instant) { bus.publish(channel, bytes); });
  }
};

/// A pose stamped `stamp`.
inline pose_t pose(Instant stamp, std::int64_t seq, double x_m = 0.0, double y_m = 0.0,
                   double yaw_rad = 0.0) {
  pose_t m{};
  m.utime = to_utime(stamp);
  m.seq = seq;
  m.x_m = x_m;
  m.y_m = y_m;
  m.yaw_rad = yaw_rad;
  m.plan_session = m.plan_id = -1;
  return m;
}

/// A command stamped `stamp`.
inline twist_t twist(Instant stamp, std::int64_t seq, double v_mps, double omega_radps) {
  twist_t m{};
  m.pose_utime = -1;
  m.utime = to_utime(stamp);
  m.seq = seq;
  m.v_mps = v_mps;
  m.omega_radps = omega_radps;
  return m;
}

/// The value of a counter in a list; −1 if the name is unknown.
template <class CountersMessage>
std::int64_t counter(const CountersMessage& m, const std::string& name) {
  for (std::size_t i = 0; i < m.name.size(); ++i) {
    if (m.name[i] == name) return m.value[i];
  }
  return -1;
}

}  // namespace tether::test
