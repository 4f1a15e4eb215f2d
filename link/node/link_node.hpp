#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <tether/peer_report_t.hpp>
#include <vector>

#include "common/base/say.hpp"
#include "common/bus/bus.hpp"
#include "common/loop/event_loop.hpp"
#include "common/loop/node.hpp"
#include "link/node/config.hpp"
#include "link/node/diagnosis.hpp"
#include "link/node/path_socket.hpp"

namespace tether::link {

inline constexpr char kReportChannel[] = "LINK/REPORT";
inline constexpr char kFatesChannel[] = "LINK/FATES";

/// LCM on one side, UDP to other hosts on the other. What comes from a peer is published, and not
/// heard here again, so that nothing goes round; LINK/… never leaves the host.
class LinkNode final : public Node {
 public:
  using Say = std::function<void(Severity severity, const std::string& line)>;

  /// `bus` must not hear itself. `say`: prints a line for the operator. Throws as PathSocket and
  /// Endpoint do.
  LinkNode(LinkConfig config, const KeyPair& own, EventLoop& loop, Bus& bus,
           const RandomKey& random, Say say);
  ~LinkNode() override;

  void finish() override {
    report();
    tell_fates();
  }

 private:
  Moment moment() const { return {loop_.now(), wall_ns()}; }
  void on_message(const Message& message);
  void on_readable(std::size_t path);
  void report();
  void report_peer(std::size_t number);
  void report_path(PeerLink& peer, std::size_t path, const std::optional<IntervalNs>& offset,
                   peer_report_t& out);
  void tell_fates();
  void tell_fates_of(std::size_t peer, std::size_t path);
  void open_path(std::size_t path);
  void renew_paths();
  void diagnose();

  LinkConfig config_;
  EventLoop& loop_;
  Bus& bus_;
  Say say_;
  std::deque<PathSocket> sockets_;
  Endpoint endpoint_;
  std::vector<Diagnosis> diagnoses_;
  std::vector<std::optional<Instant>> too_long_;  // by path, when it was noticed last
  bool copies_scheduled_ = false;
  std::int64_t seq_ = 0;
  std::int64_t fates_seq_ = 0;
};

}  // namespace tether::link
