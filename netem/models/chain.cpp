#include "netem/models/chain.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "netem/models/gilbert_elliott.hpp"
#include "netem/models/kinds.hpp"
#include "netem/models/markov_chain.hpp"

namespace tether {
namespace {

constexpr std::size_t kMaxStates = 64;
constexpr double kShortest_s = 1e-3;  // stay in a state of a chain in time

const ChainConfig& of(const LinkConfig& link) { return link.own.get<ChainConfig>(); }

bool is_per_packet(const LinkConfig& link) {
  return !of(link).probabilities.empty() && of(link).step_s == 0.0;
}

bool same_moves(const ChainConfig& a, const ChainConfig& b) {
  return a.rates_per_s == b.rates_per_s && a.probabilities == b.probabilities &&
         a.step_s == b.step_s;
}

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<ChainConfig>("chain");
  t.list("prr", &ChainConfig::prr, kRatio, "packet reception ratio of each state");
  t.list("delay_ms", &ChainConfig::delay_ms, kDelayRange_ms, "delay in each state");
  t.rows("rates_per_s", &ChainConfig::rates_per_s, {-1e3, 1e3, false},
         "rates from row to column, at most 1000 out of a state; or ...");
  t.rows("probabilities", &ChainConfig::probabilities, kRatio,
         "... probabilities of a step from row to column");
  t.number("step_s", &ChainConfig::step_s, {0.0, 1e6, false},
           "probabilities: time between steps, at least 0.001; 0 = one per packet");
  return t.take();
}

void check_rates(const LoadedLink& loaded, const std::string& name, const std::vector<double>& row,
                 std::size_t i) {
  double largest = 0.0, sum = 0.0, out = 0.0;
  for (std::size_t j = 0; j < row.size(); ++j) {
    largest = std::max(largest, std::abs(row[j]));
    sum += row[j];
    out += j == i ? 0.0 : row[j];
    if (j == i || row[j] >= 0.0) continue;
    loaded.refuse("{}: row {}, column {}: {} must not be negative", name, i + 1, j + 1, row[j]);
  }
  if (row[i] != 0.0 && std::abs(sum) > kProbabilityRounding * largest) {
    loaded.refuse(
        "{}: row {}: the diagonal, {}, must be 0 or minus the sum of the row's other entries", name,
        i + 1, row[i]);
  }
  if (out * kShortest_s > 1.0 + kProbabilityRounding) {
    loaded.refuse(
        "{}: row {}: the rates sum to {} per s, but the mean stay in a state must be at least {} s",
        name, i + 1, out, kShortest_s);
  }
}

void check_matrix(const LoadedLink& loaded, const std::string& key) {
  const ChainConfig& chain = of(loaded.link);
  const std::size_t n = chain.prr.size();
  const bool rates = chain.probabilities.empty();
  const auto& matrix = rates ? chain.rates_per_s : chain.probabilities;
  const std::string name = key + (rates ? "rates_per_s" : "probabilities");
  if (matrix.size() != n) {
    loaded.refuse("{} needs {} rows, as many as {}prr has entries, not {}", name, n, key,
                  matrix.size());
  }
  for (std::size_t i = 0; i < n; ++i) {
    const auto& row = matrix[i];
    if (row.size() != n) {
      loaded.refuse("{}: row {} needs {} entries, not {}", name, i + 1, n, row.size());
    }
    const double sum = std::accumulate(row.begin(), row.end(), 0.0);
    if (rates) {
      check_rates(loaded, name, row, i);
    } else if (std::abs(sum - 1.0) > kProbabilityRounding) {
      loaded.refuse("{}: row {} must sum to 1, not {}", name, i + 1, sum);
    }
  }
}

void check(const LoadedLink& loaded) {
  const ChainConfig& chain = of(loaded.link);
  const std::string key = loaded.prefix + "chain.";
  const std::size_t n = chain.prr.size();
  if (n == 0) {
    loaded.refuse("{0}model = \"chain\" needs {1}prr, an entry per state", loaded.prefix, key);
  }
  if (n > kMaxStates) loaded.refuse("{0}prr: at most {1} states, not {2}", key, kMaxStates, n);
  if (!chain.delay_ms.empty() && chain.delay_ms.size() != n) {
    loaded.refuse("{0}delay_ms needs {1} entries, as many as {0}prr, not {2}", key, n,
                  chain.delay_ms.size());
  }
  if (chain.rates_per_s.empty() == chain.probabilities.empty()) {
    loaded.refuse("{0}model = \"chain\" needs one of {1}rates_per_s and {1}probabilities",
                  loaded.prefix, key);
  }
  if (chain.step_s > 0.0 && chain.step_s < kShortest_s) {
    loaded.refuse("{}step_s = {} must be 0 (a step per packet) or at least {}", key, chain.step_s,
                  kShortest_s);
  }
  check_matrix(loaded, key);
}

std::string why_no_effect(const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
  if (part != "chain.step_s" || !of(link).probabilities.empty()) return "";
  return fmt::format("{}chain.probabilities is not given", prefix);
}

std::vector<LinkCondition> conditions(const ChainConfig& chain) {
  std::vector<LinkCondition> list;
  for (std::size_t i = 0; i < chain.prr.size(); ++i) {
    list.push_back(condition_of({chain.prr[i], chain.delay_in(i)}));
  }
  return list;
}

ProcessPtr make_per_packet(const ProcessNeeds& needs) {
  const ChainConfig& c = of(needs.link);
  const std::string key = needs.prefix + "chain.probabilities";
  const auto old = needs.present_as<PacketChainProcess>();
  if (old && old->states() == c.prr.size()) {
    return std::make_shared<PacketChainProcess>(c.probabilities, conditions(c), key, *old);
  }
  return std::make_shared<PacketChainProcess>(c.probabilities, conditions(c), key,
                                              needs.packet_stream());
}

std::shared_ptr<ChainClock> make_clock(const ProcessNeeds& needs) {
  const ChainConfig& c = of(needs.link);
  const std::string key = needs.prefix + "chain.";
  const RandomEngine random = needs.streams("state");
  return needs.moved_on(c.probabilities.empty()
                            ? ChainClock::from_rates(c.rates_per_s, key + "rates_per_s", random)
                            : ChainClock::from_probabilities(c.probabilities, c.step_s,
                                                             key + "probabilities", random));
}

ProcessPtr make(const ProcessNeeds& needs) {
  if (is_per_packet(needs.link)) return make_per_packet(needs);
  const bool keep = needs.same_model() && same_moves(of(*needs.before), of(needs.link));
  const auto other = needs.with_clock<ChainProcess>(keep);
  return std::make_shared<ChainProcess>(other ? other->clock() : make_clock(needs),
                                        conditions(of(needs.link)));
}

std::string not_shared(const LinkConfig& up, const LinkConfig& down) {
  return same_moves(of(up), of(down)) ? "" : "the same matrix for uplink and downlink";
}

ChannelExpectation expect(const LinkConfig& link, const ExpectedPackets& packets) {
  const ChainConfig& chain = of(link);
  std::vector<ExpectedState> states;
  for (std::size_t i = 0; i < chain.prr.size(); ++i) {
    states.push_back({fmt::format("state {}", i), chain.prr[i], packets.delay(chain.delay_in(i))});
  }
  if (!chain.rates_per_s.empty()) {
    return ChannelExpectation::process(chain.rates_per_s, packets.interval_s, std::move(states));
  }
  if (chain.step_s == 0.0) return ChannelExpectation::chain(chain.probabilities, std::move(states));
  return ChannelExpectation::stepped(chain.probabilities, chain.step_s, packets.interval_s,
                                     std::move(states));
}

std::optional<double> only_delay_ms(const LinkConfig& link) {
  const auto& delays = of(link).delay_ms;
  if (delays.empty()) return 0.0;
  const auto [least, most] = std::minmax_element(delays.begin(), delays.end());
  if (*least != *most) return std::nullopt;
  return *least;
}

void export_loss(const LinkConfig& link, const TcSender&, TcDraft& out) {
  const ChainConfig& c = of(link);
  const bool per_packet = is_per_packet(link);
  if (per_packet && c.prr.size() == 2) {
    out.command += tc_gemodel(
        {c.probabilities[0][1], c.probabilities[1][0], 1.0 - c.prr[1], 1.0 - c.prr[0]}, out.loss);
    return;
  }
  out.notes.emplace_back(
      per_packet ? "model = \"chain\" has no equivalent: netem has chains of two states "
                   "(gemodel) and that of four (state) only"
                 : "model = \"chain\" has no equivalent: netem's states step with "
                   "packets, not with time");
}

}  // namespace

ChannelModelKind chain_model() {
  ChannelModelKind kind{.name = "chain",
                        .keys = keys,
                        .check = check,
                        .why_no_effect = why_no_effect,
                        .not_shared = not_shared};
  kind.moves = [](const LinkConfig& link) {
    return is_per_packet(link) ? ChannelModelKind::Moves::per_packet
                               : ChannelModelKind::Moves::in_time;
  };
  kind.make = make;
  kind.expect = expect;
  kind.only_delay_ms = only_delay_ms;
  kind.export_loss = export_loss;
  return kind;
}

}  // namespace tether
