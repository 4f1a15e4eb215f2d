#include "can_bridge/probe/probe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>

namespace tether {
namespace {

using Need = ProbeItem::Need;
using Outcome = SdoUpload::Result::Outcome;
using Verdict = ProbeRow::Verdict;

constexpr std::uint32_t kNoData = 0x08000024;

bool is_absent(std::uint32_t abort_code) {
  return abort_code == static_cast<std::uint32_t>(canopen::Abort::no_object) ||
         abort_code == static_cast<std::uint32_t>(canopen::Abort::no_subindex) ||
         abort_code == kNoData;
}

std::string failure_text(const SdoUpload::Result& result) {
  switch (result.outcome) {
    case Outcome::aborted:
      return canopen::abort_text(result.abort_code);
    case Outcome::no_answer:
      return "no answer";
    case Outcome::garbled:
      return "the answer breaks the SDO protocol";
    case Outcome::done:
      break;
  }
  return "";
}

std::int64_t number(const ProbeItem& item, const std::vector<std::uint8_t>& bytes) {
  return canopen::read_integer(bytes.data(), static_cast<std::uint8_t>(bytes.size()),
                               item.object.is_signed);
}

/// The value that the file has for it, shown like the drive's.
std::string wanted_text(const ProbeItem& item) {
  std::vector<std::uint8_t> bytes(item.object.bytes);
  canopen::write_integer(bytes.data(), item.object.bytes, *item.wanted);
  return probe_value(item, bytes);
}

/// Compares a value that was read with what the file says.
void judge_value(const ProbeItem& item, const SdoUpload::Result& result, ProbeRow& row) {
  if (item.object.bytes == 0) return;
  row.verdict = Verdict::fits;
  if (result.size_known && result.bytes.size() != item.object.bytes) {
    row.verdict = Verdict::problem;
    row.remark = fmt::format("has {} bits, the file says {}", 8 * result.bytes.size(),
                             8 * item.object.bytes);
    return;
  }
  if (!item.wanted || number(item, result.bytes) == *item.wanted) return;
  row.verdict = item.must_equal ? Verdict::problem : Verdict::note;
  row.remark = (item.must_equal ? "must be " : "start-up sets ") + wanted_text(item);
}

/// Explains why there is no value.
void judge_failure(const ProbeItem& item, const SdoUpload::Result& result, ProbeRow& row) {
  row.value = "-";
  row.remark = failure_text(result);
  const bool write_only =
      result.outcome == Outcome::aborted &&
      result.abort_code == static_cast<std::uint32_t>(canopen::Abort::write_only);
  if (write_only) return;
  if (item.need == Need::required) {
    row.verdict = Verdict::problem;
    row.remark += ": the file needs it";
  } else if (item.need == Need::optional) {
    row.verdict = Verdict::note;
    row.remark += ": the file can do without";
  }
}

bool shown(const ProbeItem& item, const SdoUpload::Result& result) {
  if (item.need != Need::quiet || result.outcome == Outcome::done) return true;
  return !(result.outcome == Outcome::aborted && is_absent(result.abort_code));
}

}  // namespace

bool ProbedNode::fits() const {
  return answered && std::none_of(rows.begin(), rows.end(), [](const ProbeRow& row) {
           return row.verdict == Verdict::problem;
         });
}

Probe::Probe(const std::vector<std::uint8_t>& nodes, const Cia402Config* config, Instant now)
    : begin_(now), judges_(config != nullptr) {
  for (const std::uint8_t id : nodes) {
    assert(id >= 1 && id <= 127);
    nodes_.push_back({id, probe_items(id, config), {}, {}, {}, false});
  }
}

Probe Probe::scan(Instant now) {
  Probe probe(now);
  probe.tries_for_life_ = 1;
  for (std::uint8_t id = 1; id <= 127; ++id) {
    probe.nodes_.push_back({id, scan_items(), {}, {}, {}, false});
  }
  return probe;
}

std::vector<CanFilter> Probe::filters() {
  return {{canopen::kSdoResponse, 0x780}, {canopen::kHeartbeat, 0x780}};
}

void Probe::on_frame(const CanFrame& frame, Instant /*now*/) {
  if (frame.extended || frame.remote) return;
  const auto id = static_cast<std::uint8_t>(frame.id & 0x7F);
  const std::uint32_t function = frame.id & 0x780U;
  const bool beat = function == canopen::kHeartbeat && frame.size == 1;
  if (beat || function == canopen::kSdoResponse) heard_.insert(id);
  for (Node& node : nodes_) {
    if (node.id != id) continue;
    if (beat) {
      const auto state = static_cast<canopen::NmtState>(frame.data[0] & 0x7F);
      if (!node.nmt && state == canopen::NmtState::boot_up) {  // no node was there to answer
        node.pending.reset();
        node.results.clear();
      }
      node.nmt = state;
    }
    if (function == canopen::kSdoResponse && node.pending) node.pending->on_frame(frame);
  }
}

void Probe::tick(Instant now, std::vector<CanFrame>& out) {
  assert(!nodes_.empty());
  const std::size_t first = out.size();
  const std::size_t begin = turn_;
  for (std::size_t i = 0; i < nodes_.size() && out.size() == first; ++i) {
    Node& node = nodes_[turn_ = (begin + i) % nodes_.size()];
    if (node.pending && node.pending->result()) {
      node.results.push_back(*node.pending->result());
      node.answered = node.answered || node.results.back().outcome != Outcome::no_answer;
      node.pending.reset();
    }
    if (finished(node)) continue;
    if (!node.pending) {
      const ObjectRef& object = node.items[node.results.size()].object;
      node.pending.emplace(node.id, object.index, object.sub, kTimeout, kRetries);
    }
    node.pending->tick(now, out);
  }
  turn_ = (turn_ + 1) % nodes_.size();
  // A probe must never change anything.
  for (std::size_t i = first; i < out.size(); ++i) assert(is_upload_request(out[i]));
}

bool Probe::finished(const Node& node) const {
  if (!node.answered && node.results.size() >= tries_for_life_) return true;
  return node.results.size() == node.items.size();
}

bool Probe::done(Instant now) const {
  return now - begin_ >= kListen &&
         std::all_of(nodes_.begin(), nodes_.end(), [this](const Node& n) { return finished(n); });
}

std::vector<ProbedNode> Probe::report() const {
  std::vector<ProbedNode> report;
  for (const Node& node : nodes_) {
    ProbedNode probed{node.id, node.answered, node.nmt, {}};
    for (std::size_t i = 0; node.answered && i < node.results.size(); ++i) {
      const ProbeItem& item = node.items[i];
      const SdoUpload::Result& result = node.results[i];
      if (!shown(item, result)) continue;
      ProbeRow row;
      row.object = fmt::format("0x{:04X}:{:02X}", item.object.index, item.object.sub);
      row.name = item.name;
      if (result.outcome == Outcome::done) {
        row.value = probe_value(item, result.bytes);
        if (judges_) judge_value(item, result, row);
      } else {
        judge_failure(item, result, row);
      }
      probed.rows.push_back(row);
    }
    report.push_back(probed);
  }
  return report;
}

}  // namespace tether
