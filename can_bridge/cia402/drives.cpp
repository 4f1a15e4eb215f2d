#include "can_bridge/cia402/drives.hpp"

#include <algorithm>

#include "can_bridge/cia402/config.hpp"

namespace tether::cia402 {

using canopen::NmtState;

namespace {

/// Time to wait for an answer to a drive's stop by SDO before it is sent again.
constexpr Duration kImpatience = std::chrono::milliseconds(50);

}  // namespace

Node::Node(const Cia402Config& config, std::uint8_t number)
    : id(number),
      name(node_name(config, number)),
      startup(config, number),
      read_back(config, number),
      inquiry(config, number, std::chrono::milliseconds(config.sdo_timeout_ms)),
      stopper(config, number,
              std::min<Duration>(kImpatience, std::chrono::milliseconds(config.sdo_timeout_ms))) {}

void Node::begin_inquiry(bool stop_first) {
  inquiry.begin(stop_first);
  recalled.reset();
}

bool Node::may_be_stopped() const {
  return state == NmtState::stopped || (!heard && inquiry.unanswered());
}

void Node::on_foreign_nmt(const CanFrame& frame) {
  if (frame.size != 2 || (frame.data[1] != 0 && frame.data[1] != id)) return;
  const auto command = static_cast<canopen::NmtCommand>(frame.data[0]);
  if (command == canopen::NmtCommand::start) return;
  state.reset();
  if (command == canopen::NmtCommand::stop) state = NmtState::stopped;
}

std::optional<NmtState> Node::on_heartbeat(const CanFrame& frame, Instant now) {
  // Bit 7 is zero in a heartbeat; some drives toggle it, as in answers to node guarding (CiA 301).
  const std::uint8_t byte = frame.data[0];
  const auto told = static_cast<NmtState>(byte == 0x80 ? byte : byte & 0x7F);
  const bool known = told == NmtState::boot_up || told == NmtState::stopped ||
                     told == NmtState::operational || told == NmtState::pre_operational;
  if (frame.size != 1 || !known) return std::nullopt;
  state = told;
  if (told == NmtState::boot_up) {
    heard = running = false;
    return told;
  }
  heartbeat_stamp = now;
  heard = true;
  if (told == NmtState::operational) running = true;
  return told;
}

Nodes::Nodes(const Cia402Config& config) {
  for (const std::uint8_t id : config.nodes()) nodes_.emplace_back(config, id);
}

bool Nodes::any_heard() const { return std::ranges::any_of(nodes_, &Node::heard); }
bool Nodes::any_running() const { return std::ranges::any_of(nodes_, &Node::running); }
bool Nodes::all_operational() const { return std::ranges::all_of(nodes_, &Node::operational); }

bool Nodes::show_mode_late(std::uint8_t id) const {
  return std::ranges::any_of(
      nodes_, [id](const Node& node) { return node.id == id && node.startup.shows_mode_late(); });
}

void Nodes::begin_inquiry(bool commanding) {
  for (Node& node : nodes_) {
    node.heard = node.state && node.state != NmtState::boot_up;
    node.running = commanding && node.operational();
    node.begin_inquiry();
  }
}

void Nodes::begin_startup() {
  forget_states();
  for (Node& node : nodes_) {
    node.heard = node.running = node.pdos_doubtful = false;
    node.startup.begin();
  }
}

void Nodes::forget_states() {
  for (Node& node : nodes_) node.state.reset();
}

std::string Nodes::progress() const {
  std::string all;
  for (const Node& node : nodes_) all += (all.empty() ? "" : "; ") + node.startup.progress();
  return all;
}

std::string Nodes::refusals() const {
  std::string all;
  for (const Node& node : nodes_) {
    if (node.startup.refusal().empty()) continue;
    all += (all.empty() ? "" : "; ") + node.startup.refusal();
  }
  return all;
}

bool Nodes::any_reset() const {
  return std::ranges::any_of(nodes_, [](const Node& node) { return node.startup.has_reset(); });
}

bool Nodes::started_up() const {
  return std::ranges::all_of(nodes_, [](const Node& node) { return node.startup.done(); });
}

std::vector<std::string> Nodes::notes() const {
  std::vector<std::string> all;
  for (const Node& node : nodes_) {
    all.insert(all.end(), node.startup.notes().begin(), node.startup.notes().end());
  }
  return all;
}

}  // namespace tether::cia402
