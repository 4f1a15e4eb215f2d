#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/bus/sdo_upload.hpp"
#include "can_bridge/probe/items.hpp"
#include "common/base/time.hpp"

namespace tether {

/// Result for one object.
struct ProbeRow {
  enum class Verdict { plain, fits, note, problem };
  std::string object;  ///< "0x6041:00"
  std::string name;
  std::string value;   ///< "-" if there is none
  std::string remark;  ///< why not, or what the file says
  Verdict verdict = Verdict::plain;
};

struct ProbedNode {
  std::uint8_t node = 0;
  bool answered = false;  ///< to any SDO request
  /// State in its newest heartbeat; empty: none was heard.
  std::optional<canopen::NmtState> nmt;
  std::vector<ProbeRow> rows;

  bool fits() const;  ///< answered, and no row is a problem
};

/// Looks at drives without changing anything: SDO uploads of probe_items() or scan_items(), all
/// nodes at the same time, while it listens for heartbeats. No I/O and no clock.
class Probe {
 public:
  static constexpr Duration kListen = std::chrono::milliseconds{1500};  ///< for heartbeats
  static constexpr Duration kTimeout = std::chrono::milliseconds{300};  ///< for each answer
  static constexpr int kRetries = 1;

  /// `config` may be null.
  Probe(const std::vector<std::uint8_t>& nodes, const Cia402Config* config, Instant now);
  /// Asks all nodes 1…127 for their presence. Takes 0.9 s at a tick each 2 ms, plus listening.
  static Probe scan(Instant now);

  static std::vector<CanFilter> filters();
  void on_frame(const CanFrame& frame, Instant now);
  /// Every few milliseconds. Appends one frame at most, for an adapter's queue holds few; it
  /// is_upload_request() to one of the nodes: it asserts so.
  void tick(Instant now, std::vector<CanFrame>& out);

  /// All is read, or given up: a node that boots meanwhile is asked from the beginning, once; one
  /// that answers none of its first three objects (in a scan: the first) is not asked for more.
  bool done(Instant now) const;
  std::vector<ProbedNode> report() const;
  /// All nodes whose heartbeat, boot-up message or answer to anybody was heard.
  const std::set<int>& heard() const { return heard_; }

 private:
  struct Node {
    std::uint8_t id = 0;
    std::vector<ProbeItem> items;
    std::vector<SdoUpload::Result> results;  // results of the first items
    std::optional<SdoUpload> pending;
    std::optional<canopen::NmtState> nmt;
    bool answered = false;
  };

  explicit Probe(Instant now) : begin_(now) {}
  bool finished(const Node& node) const;

  Instant begin_;
  bool judges_ = false;  // there is a file to compare with
  std::size_t tries_for_life_ = 3;
  std::vector<Node> nodes_;
  std::size_t turn_ = 0;  // index of the node that may send first
  std::set<int> heard_;
};

/// The report as tables, with hints where a node did not answer. `heard`: see Probe.
std::string format_probe(const std::vector<ProbedNode>& nodes, const std::set<int>& heard,
                         const std::string& drivetrain_name);
/// The report of a scan: a row for each node that answers or was heard.
std::string format_scan(const std::vector<ProbedNode>& nodes, const std::set<int>& heard);

}  // namespace tether
