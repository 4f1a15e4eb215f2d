#pragma once

#include <cstddef>
#include <vector>

namespace tether {

/// A place in the box that is searched, each coordinate in [0, 1].
using SearchPoint = std::vector<double>;

/// A point and its objective, which is to be small; infinity for one that is no good at all.
struct SearchedPoint {
  SearchPoint point;
  double objective = 0.0;
};

/// How many points a search looks at, those that are given among them, and in how many rounds.
struct SearchBudget {
  std::size_t evaluations = 0;
  std::size_t rounds = 0;
  /// Points of the sequence that are left to other searches: one that skips what another used
  /// looks at other points.
  std::size_t skipped = 0;
};

/// Point `number` of the low-discrepancy sequence over the whole box; number 0 is its centre.
SearchPoint sequence_point(std::size_t keys, std::size_t number);

/// So many points has each of the rounds: a third of the budget the first, the others the rest in
/// equal parts, the earlier ones one more where that does not divide. Both numbers must be positive
/// and rounds ≤ evaluations / 2, or there may be one round.
std::vector<std::size_t> round_sizes(const SearchBudget& budget);

/// The least objective; the first one of equals.
std::size_t best_of(const std::vector<SearchedPoint>& searched);

/// A bounded search without derivatives and without random numbers. The first round is the given
/// points and a low-discrepancy design over the whole box. Each later one is such a design over a
/// box around the best point so far, whose sides are kShrink of those of the last round, cut off at
/// the whole box. The design is Sobol's sequence (Boost.Random's, with Joe and Kuo's direction
/// numbers), which goes on from round to round: the search's n-th point has number skipped + n, but
/// for those that are given, which are in the place of the first ones.
///
/// The points of a round do not depend on each other, so all runs of a round may be made side by
/// side. A local method such as Nelder and Mead's needs fewer points near a smooth minimum, but one
/// after another, and ε has edges: it jumps where one packet more or less loses a vehicle.
///
/// `searched`: all points of the rounds before, in order; none before the first. Returns the next
/// round's points; none after the last. `given`: at least one, and no more than the first round
/// has. One outside of the box is evaluated as it is; the box of later rounds is around the nearest
/// point within.
std::vector<SearchPoint> next_points(const SearchBudget& budget,
                                     const std::vector<SearchPoint>& given,
                                     const std::vector<SearchedPoint>& searched);

/// Shrink factor for the sides of the last round's box.
inline constexpr double kShrink = 0.65;

}  // namespace tether
