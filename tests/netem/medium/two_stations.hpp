#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "netem/medium/contention.hpp"

namespace tether {

/// Two saturated stations, exactly: their counters after each transmission are a Markov chain.
struct TwoStations {
  double first = 0.0, second = 0.0;  ///< share of the transmissions that are frames of this station
  double collisions = 0.0;           ///< share of the transmissions
};

/// The chain of two stations, solved by iteration. Attempts have limits.
class TwoStationsChain {
 public:
  /// `first_is_stronger`: of the frames of a collision, that of the first is received.
  TwoStationsChain(const AccessParameters& first, const AccessParameters& second,
                   ContentionRules::Countdown countdown, bool first_is_stronger = false)
      : first_(first),
        second_(second),
        countdown_(countdown),
        first_is_stronger_(first_is_stronger) {}

  TwoStations solve(int rounds) {
    std::vector<double> now(places(first_) * places(second_), 0.0);
    now[index({0, kDraws}, {0, kDraws})] = 1.0;
    TwoStations out;
    for (int round = 0; round < rounds; ++round) {
      out = {};
      std::vector<double> next(now.size(), 0.0);
      for (std::size_t i = 0; i < now.size(); ++i) {
        if (now[i] > 0.0) step(i, now[i], next, out);
      }
      now = std::move(next);
    }
    return out;
  }

 private:
  static constexpr int kDraws = -1;
  /// State of one station: failed attempts of its frame, and slots that are left to count.
  struct State {
    int stage, left;
  };
  static std::size_t lefts(const AccessParameters& a) {
    return static_cast<std::size_t>(a.cw_max) + 2;
  }
  static std::size_t places(const AccessParameters& a) {
    return static_cast<std::size_t>(a.attempts) * lefts(a);
  }
  static std::size_t place(const AccessParameters& a, const State& s) {
    return static_cast<std::size_t>(s.stage) * lefts(a) + static_cast<std::size_t>(s.left + 1);
  }
  static State state(const AccessParameters& a, std::size_t place) {
    return {static_cast<int>(place / lefts(a)), static_cast<int>(place % lefts(a)) - 1};
  }
  std::size_t index(const State& a, const State& b) const {
    return place(first_, a) * places(second_) + place(second_, b);
  }
  static int window(const AccessParameters& a, int stage) {
    return std::min(((a.cw_min + 1) << stage) - 1, a.cw_max);
  }
  static State failed(const AccessParameters& a, const State& s) {
    return {s.stage + 1 < a.attempts ? s.stage + 1 : 0, kDraws};
  }
  /// Who did not send in `slot`, with its counter ending in `zero_at`.
  State waits(const AccessParameters& a, const State& s, int zero_at, int slot) const {
    const int passed =
        slot + (countdown_ == ContentionRules::Countdown::slot_boundaries ? 1 : 0) - a.aifsn;
    return {s.stage, std::max(0, zero_at - a.aifsn - std::max(0, passed))};
  }

  void step(std::size_t from, double p, std::vector<double>& next, TwoStations& out) const {
    const State a = state(first_, from / places(second_));
    const State b = state(second_, from % places(second_));
    const int a_first = std::max(a.left, 0), b_first = std::max(b.left, 0);
    const int a_last = a.left == kDraws ? window(first_, a.stage) : a.left;
    const int b_last = b.left == kDraws ? window(second_, b.stage) : b.left;
    const double each = p / (a_last - a_first + 1) / (b_last - b_first + 1);
    for (int i = a_first; i <= a_last; ++i) {
      for (int j = b_first; j <= b_last; ++j) {
        const int a_at = first_.aifsn + i, b_at = second_.aifsn + j;
        if (a_at == b_at) {
          out.collisions += each;
          if (first_is_stronger_) out.first += each;
          const State after = first_is_stronger_ ? State{0, kDraws} : failed(first_, a);
          next[index(after, failed(second_, b))] += each;
        } else if (a_at < b_at) {
          out.first += each;
          next[index({0, kDraws}, waits(second_, b, b_at, a_at))] += each;
        } else {
          out.second += each;
          next[index(waits(first_, a, a_at, b_at), {0, kDraws})] += each;
        }
      }
    }
  }

  AccessParameters first_, second_;
  ContentionRules::Countdown countdown_;
  bool first_is_stronger_;
};

}  // namespace tether
