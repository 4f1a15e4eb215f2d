#include "tools/experiment/sweep/search.hpp"

#include <algorithm>
#include <boost/random/sobol.hpp>
#include <boost/random/uniform_01.hpp>
#include <cassert>
#include <cmath>

namespace tether {
namespace {

/// The box of a round, along one axis.
struct Span {
  double low = 0.0, high = 1.0;
};

Span span_around(double centre, double side) {
  const double inside = std::clamp(centre, 0.0, 1.0);
  return {std::max(0.0, inside - side / 2), std::min(1.0, inside + side / 2)};
}

/// `count` points of Sobol's sequence from number `first` on, each within `box`.
std::vector<SearchPoint> design(const std::vector<Span>& box, std::size_t first,
                                std::size_t count) {
  boost::random::sobol sequence(box.size());
  sequence.discard(first * box.size());
  boost::random::uniform_01<double> unit;
  std::vector<SearchPoint> points(count, SearchPoint(box.size()));
  for (SearchPoint& point : points) {
    for (std::size_t i = 0; i < box.size(); ++i) {
      point[i] = box[i].low + (box[i].high - box[i].low) * unit(sequence);
    }
  }
  return points;
}

}  // namespace

SearchPoint sequence_point(std::size_t keys, std::size_t number) {
  return design(std::vector<Span>(keys), number, 1).front();
}

std::vector<std::size_t> round_sizes(const SearchBudget& budget) {
  assert(budget.evaluations > 0 && budget.rounds > 0);
  if (budget.rounds == 1) return {budget.evaluations};
  assert(budget.rounds <= budget.evaluations / 2);
  const std::size_t later = budget.rounds - 1;
  const std::size_t first = std::min((budget.evaluations + 2) / 3, budget.evaluations - later);
  const std::size_t rest = budget.evaluations - first;
  std::vector<std::size_t> sizes{first};
  for (std::size_t i = 0; i < later; ++i)
    sizes.push_back(rest / later + (i < rest % later ? 1 : 0));
  return sizes;
}

std::size_t best_of(const std::vector<SearchedPoint>& searched) {
  assert(!searched.empty());
  const auto best = std::min_element(
      searched.begin(), searched.end(),
      [](const SearchedPoint& a, const SearchedPoint& b) { return a.objective < b.objective; });
  return static_cast<std::size_t>(best - searched.begin());
}

std::vector<SearchPoint> next_points(const SearchBudget& budget,
                                     const std::vector<SearchPoint>& given,
                                     const std::vector<SearchedPoint>& searched) {
  const std::vector<std::size_t> sizes = round_sizes(budget);
  std::size_t round = 0, before = 0;
  while (round < sizes.size() && before < searched.size()) before += sizes[round++];
  assert(before == searched.size());
  if (round == sizes.size()) return {};
  std::vector<Span> box(given.front().size());
  if (round == 0) {
    assert(given.size() <= sizes[0]);
    std::vector<SearchPoint> points = given;
    const std::vector<SearchPoint> others =
        design(box, budget.skipped + given.size(), sizes[0] - given.size());
    points.insert(points.end(), others.begin(), others.end());
    return points;
  }
  const double side = std::pow(kShrink, static_cast<double>(round));
  const SearchPoint& best = searched[best_of(searched)].point;
  std::transform(best.begin(), best.end(), box.begin(),
                 [side](double centre) { return span_around(centre, side); });
  return design(box, budget.skipped + before, sizes[round]);
}

}  // namespace tether
