#include "tests/campaign/totals.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>

#include "common/base/random.hpp"
#include "tests/campaign/rules.hpp"

namespace tether::campaign {
namespace {

/// Cause in a stop's reason: the first of these that it contains.
std::string cause_of(const std::string& reason) {
  constexpr std::pair<const char*, const char*> kCauses[] = {
      {"e-stop", "e-stop"},
      {"disarmed by request", "DISARM"},
      {"unseen for", "plans: unseen for too long"},
      {"horizon of the plan", "plans: horizon over"},
      {"another session", "plans: stop of another session"},
      {"newest command", "command too old"},
      {"two senders", "two senders"},
      {"running already", "bridge killed"},
      {"OperationEnabled to", "drive left operation"},
      {"another sender uses", "unknown sender on the bus"},
      {"bridge itself stood still", "bridge suspended"},
      {"bus-off", "bus-off"},
      {"stalled", "bus stalled"},
      {"interface down", "bus down"},
      {"emergency", "EMCY"},
      {"does not follow", "wheel does not follow"},
      {" wheel: ", "witness or first way is wrong"},
      {"rebooted", "drive rebooted"},
      {"feedback", "feedback missing"},
      {"heartbeat", "heartbeat missing"}};
  for (const auto& [part, cause] : kCauses) {
    if (reason.find(part) != std::string::npos) return cause;
  }
  return "other: " + reason.substr(0, 60);
}

std::uint64_t fingerprint_of(const Record& record) {
  std::uint64_t hash = 0;
  const auto mix = [&hash](double value) {
    hash = split_mix(hash ^ std::bit_cast<std::uint64_t>(value));
  };
  for (const StateSample& s : record.states) {
    mix(s.state);
    mix(s.twist.v_mps);
    mix(s.twist.omega_radps);
  }
  for (const WheelSample& w : record.wheels) {
    mix(w.rim_mps[0]);
    mix(w.rim_mps[1]);
  }
  return hash;
}

}  // namespace

std::vector<Finding> check(std::uint64_t seed, const Record& record) {
  std::vector<Finding> found;
  for (const Rule& rule : rules()) {
    if (const auto v = rule.broken(record)) found.push_back({seed, rule.name, v->when, v->what});
  }
  return found;
}

void Totals::add(std::uint64_t seed, const Record& record) {
  for (Finding& finding : check(seed, record)) findings.push_back(std::move(finding));
  fingerprint += fingerprint_of(record);
  ++runs;
  armed_runs += record.armed_s > 0.0 ? 1 : 0;
  simulated_s += to_seconds(record.end);
  armed_s += record.armed_s;
  driven_m += record.driven_m;
  for (const Fault& fault : record.faults) ++faults[row_of(fault.kind).name];
  for (const std::string& reason : record.stops) ++stops[cause_of(reason)];
}

void Totals::add(const Totals& other) {
  runs += other.runs;
  armed_runs += other.armed_runs;
  simulated_s += other.simulated_s;
  armed_s += other.armed_s;
  driven_m += other.driven_m;
  for (const auto& [name, count] : other.faults) faults[name] += count;
  for (const auto& [name, count] : other.stops) stops[name] += count;
  fingerprint += other.fingerprint;
  findings.insert(findings.end(), other.findings.begin(), other.findings.end());
  std::sort(findings.begin(), findings.end(), [](const Finding& a, const Finding& b) {
    return std::pair(a.seed, a.rule) < std::pair(b.seed, b.rule);
  });
}

std::string Totals::text() const {
  std::string out =
      fmt::format("{} runs, {:.0f} s simulated, {} runs armed, {:.0f} s armed, {:.1f} km driven\n",
                  runs, simulated_s, armed_runs, armed_s, driven_m * 1e-3);
  out += fmt::format("fingerprint {:016x}\n", fingerprint);
  out += "faults\n";
  for (const auto& [name, count] : faults) out += fmt::format("  {:8} {}\n", count, name);
  out += "stops\n";
  for (const auto& [name, count] : stops) out += fmt::format("  {:8} {}\n", count, name);
  std::map<std::string, std::int64_t> broken;
  for (const Finding& f : findings) ++broken[f.rule];
  out += fmt::format("{} violations\n", findings.size());
  for (const auto& [name, count] : broken) out += fmt::format("  {:8} {}\n", count, name);
  return out;
}

}  // namespace tether::campaign
