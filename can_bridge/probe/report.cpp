#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "can_bridge/probe/probe.hpp"

namespace tether {
namespace {

using Verdict = ProbeRow::Verdict;

const char* mark(Verdict verdict) {
  switch (verdict) {
    case Verdict::fits:
      return "ok";
    case Verdict::note:
      return "note";
    case Verdict::problem:
      return "PROBLEM";
    case Verdict::plain:
      break;
  }
  return "";
}

std::string nmt_text(const std::optional<canopen::NmtState>& state) {
  if (!state) return "no heartbeat";
  switch (*state) {
    case canopen::NmtState::boot_up:
      return "has just booted";
    case canopen::NmtState::stopped:
      return "heartbeat: stopped";
    case canopen::NmtState::operational:
      return "heartbeat: operational";
    case canopen::NmtState::pre_operational:
      return "heartbeat: pre-operational";
  }
  return fmt::format("heartbeat: unknown state 0x{:02X}", static_cast<unsigned>(*state));
}

std::string rows_text(const std::vector<ProbeRow>& rows) {
  std::size_t name_width = 0, value_width = 0;
  for (const ProbeRow& row : rows) {
    name_width = std::max(name_width, row.name.size());
    value_width = std::max(value_width, std::min<std::size_t>(row.value.size(), 40));
  }
  std::string text;
  for (const ProbeRow& row : rows) {
    std::string line = fmt::format("  {}  {:{}}  {:{}}  {:7}  {}", row.object, row.name, name_width,
                                   row.value, value_width, mark(row.verdict), row.remark);
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + "\n";
  }
  return text;
}

constexpr char kNoNode[] =
    "  No node was heard on this bus. Check: supply of the drives, node ids, CAN plug,\n"
    "  bit rate on both sides (`ip -details link show`), 120 Ohm at both ends, CAN_H\n"
    "  and CAN_L swapped. On a virtual bus: is tether-can-drive running on it?\n";

std::string silence_text(const ProbedNode& node, const std::set<int>& heard) {
  std::string text = fmt::format("node {}: does not answer ({})\n", node.node, nmt_text(node.nmt));
  if (node.nmt) {
    return text +
           "  It lives, but its SDO server is silent: another master busy with it? Its own "
           "0x1200?\n";
  }
  if (heard.empty()) return text + kNoNode;
  return text + fmt::format(
                    "  Heard on this bus: {} {}. Check the node id that is set in this drive, its "
                    "supply\n  and its plug.\n",
                    heard.size() == 1 ? "node" : "nodes", fmt::join(heard, ", "));
}

}  // namespace

std::string format_probe(const std::vector<ProbedNode>& nodes, const std::set<int>& heard,
                         const std::string& drivetrain_name) {
  std::string text;
  for (const ProbedNode& node : nodes) {
    if (!text.empty()) text += "\n";
    if (!node.answered) {
      text += silence_text(node, heard);
      continue;
    }
    text += fmt::format("node {}: answers, {}\n{}", node.node, nmt_text(node.nmt),
                        rows_text(node.rows));
  }
  if (drivetrain_name.empty()) return text;
  const bool answered =
      std::all_of(nodes.begin(), nodes.end(), [](const ProbedNode& n) { return n.answered; });
  const bool fits =
      std::all_of(nodes.begin(), nodes.end(), [](const ProbedNode& n) { return n.fits(); });
  const char* const verdict = fits
                                  ? "fits, as far as reading can tell; writing is tried at start-up"
                              : answered ? "does NOT fit: see PROBLEM above"
                                         : "cannot be compared: a drive is missing";
  return text + fmt::format("\n\"{}\" {}\n", drivetrain_name, verdict);
}

std::string format_scan(const std::vector<ProbedNode>& nodes, const std::set<int>& heard) {
  std::string rows;
  const auto add = [&rows](const auto& node, const std::string& type, const std::string& vendor,
                           const std::string& product, const std::string& rest) {
    rows += fmt::format("{:>4}  {:<26}  {:<10}  {:<12}  {}", node, type, vendor, product, rest);
    rows.erase(rows.find_last_not_of(' ') + 1);
    rows += "\n";
  };
  add("node", "device type", "vendor", "product code", "");
  const std::size_t head = rows.size();
  std::size_t answered = 0;
  for (const ProbedNode& node : nodes) {
    if (node.answered) {
      ++answered;
      add(node.node, node.rows.at(0).value, node.rows.at(1).value, node.rows.at(2).value,
          nmt_text(node.nmt));
    } else if (heard.contains(node.node)) {
      add(node.node, "does not answer", "-", "-", nmt_text(node.nmt) + "; a master?");
    }
  }
  if (rows.size() == head) return fmt::format("no node of 1 to 127 answers\n{}", kNoNode);
  return rows + fmt::format("{} of 127 node ids answer{}\n", answered, answered == 1 ? "s" : "");
}

}  // namespace tether
