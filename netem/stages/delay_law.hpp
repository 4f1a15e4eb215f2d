#pragma once

#include <vector>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "netem/stages/jitter_laws.hpp"

namespace tether {

/// Largest score from 52-bit uniform numbers: Φ(−8.3) < 2^−53.
inline constexpr double kMaxScore = 8.3;

/// A law of delays, as the function that turns a normal score z (a standard normal deviate) into a
/// delay: x(z) = Q(Φ(z)), Q the law's quantile function. Never decreases in z.
///
/// mean m and standard deviation s are those of the law before the link cuts the total delay at
/// zero:
/// - constant: m.
/// - uniform: on m ± √3 s. tc's "delay T J" has s = J/√3.
/// - normal: as tc's "distribution normal" with J = s.
/// - pareto: m + s (Y − E Y)/sd(Y), P[Y > y] = y^−a for y ≥ 1, a = shape > 2. tc's table is that of
///   a = 3 (iproute2, netem/pareto.c), scaled and cut at its 16 bits.
/// - paretonormal: m + s W/sd(W), W = 0.25 Z + 0.75 (4/3)(Y − E Y), Z and Y quantiles of the normal
///   and of that Pareto law at the same probability (iproute2, netem/paretonormal.c).
/// - gamma: shape (m/s)², scale s²/m; m > 0.
/// - lognormal: exp(μ + σ Z), σ² = ln(1 + (s/m)²), μ = ln m − σ²/2; m > 0.
/// - table: Q linear between the given quantiles at probabilities 0, 1/(n−1) … 1; m and s shift and
///   scale nothing.
/// All but normal and table are tabulated over z in ±kMaxScore, with relative errors below 1e-4 of
/// Q or of s, whichever is less strict.
class DelayLaw {
 public:
  /// `settings.law` is not none; scenario loading has checked the rest. `table_ms` are the
  /// quantiles of law = table, ascending.
  DelayLaw(const JitterSettings& settings, const std::vector<double>& table_ms);

  /// In seconds; may be negative.
  double at_score(double z) const;

 private:
  double between(double position) const;

  JitterLaw::Form form_;
  double mean_s_;
  double sd_s_;
  std::vector<double> table_;  // over z or, of law = table, over probability; seconds
};

/// The quantiles for DelayLaw of law = table: the settings' own, or what its file holds. The file
/// has one delay in ms a line; blank lines and lines that begin with '#' do not count; order does
/// not matter. Empty for other laws. Throws UsageError with file, line and reason.
std::vector<double> load_delay_table(const JitterSettings& settings);

/// Successive delays. The n-th is a function of the stream and of n: one draw per packet.
///
/// Correlation: a first-order autoregressive Gaussian copula. z_0 = ε_0 and
/// z_n = c z_{n−1} + √(1−c²) ε_n with independent standard normal ε are correlated with c^k at lag
/// k and standard normal each, so the delays x(z_n) have exactly the law, whatever c. Their own
/// correlation is c^k for the normal law and a little less for others; their rank correlation
/// (Spearman) is (6/π) asin(c^k/2) for every continuous law. tc's correlation is another thing: it
/// averages successive numbers, which narrows the law.
class DelaySequence {
 public:
  DelaySequence(const DelayLaw& law, double correlation, RandomEngine random);

  /// May be negative; within ±1e6 s.
  Duration next();

  /// Another law and correlation from the next packet on; the normal scores go on.
  void set(const DelayLaw& law, double correlation);
  const DelayLaw& law() const { return law_; }
  /// Passes over the draws of so many packets, before the first.
  void skip(std::int64_t packets) { random_.discard(static_cast<std::uint64_t>(packets)); }

 private:
  DelayLaw law_;
  double keep_;
  double renew_;
  RandomEngine random_;
  double score_ = 0.0;
  bool begun_ = false;
};

/// A standard normal deviate from exactly one draw, |z| < 8.3: the inverse of Φ by Wichura's
/// algorithm AS 241 (Applied Statistics 37(3), 1988), to 1e-15 of its value.
double draw_normal_score(RandomEngine& random);

}  // namespace tether
