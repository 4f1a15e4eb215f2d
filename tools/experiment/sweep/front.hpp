#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tools/experiment/statistics/statistics.hpp"
#include "tools/experiment/statistics/survival.hpp"
#include "tools/experiment/sweep/grid.hpp"
#include "tools/experiment/sweep/worth.hpp"

namespace tether {

/// A choice between survival and accuracy, measured with seeds that no search has seen.
struct FrontPoint {
  std::string law;
  std::vector<KeyValue> gains;
  Share lost;  ///< share of the runs of all conditions
  Worth worth;
  Interval error_interval;   ///< interval of worth.survivors_error
  bool is_on_front = false;  ///< no other point has less of one without more of the other
};

/// At most so many points of a law are measured: the ends of its front and, evenly by number, of
/// what is between them.
inline constexpr std::size_t kFrontPoints = 5;

/// The numbers of those candidates that no other one beats both in the share of lost vehicles and
/// in the error of the others, by ascending share; of equal ones the first, and at most `most` of
/// them. `most` is at least 2.
std::vector<std::size_t> front_of(const std::vector<Worth>& candidates, std::size_t most);

/// `runs`: of each condition, all with the same seeds in the same order. The error's interval is
/// BCa's over the seeds, which are drawn for all conditions at once.
FrontPoint front_point(const std::string& law, const std::vector<KeyValue>& gains,
                       const WorthRule& rule, const std::vector<std::vector<TunedRun>>& runs);

/// Says which of all laws' points are on the front.
void mark_front(std::vector<FrontPoint>& points);

/// The points as a table in Markdown, and as CSV with a row for each point, with its gains.
std::string front_table(const std::vector<FrontPoint>& points,
                        const std::vector<std::string>& conditions);
std::string front_csv(const std::vector<FrontPoint>& points,
                      const std::vector<std::string>& conditions);

}  // namespace tether
