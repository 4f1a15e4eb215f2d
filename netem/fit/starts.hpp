#pragma once

#include <vector>

#include "netem/fit/likelihood.hpp"
#include "netem/models/gilbert_elliott.hpp"

namespace tether {

/// Places from which to climb the likelihood of a Gilbert–Elliott model: the three most likely of a
/// set. Each element of the set takes everything between losses no further apart than g packets as
/// the bad state. The set has g = 1, 2, 4 … 1024, with lone losses in the bad or in the good state.
/// 1−h is 1 unless it is free, 1−k is 0 unless it is free. All values are strictly inside (0, 1)
/// where free.
std::vector<GilbertElliott> fit_starts(const RunLog& log, bool free_bad, bool free_good);

}  // namespace tether
