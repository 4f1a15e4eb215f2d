#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "margin/theory/mean_square.hpp"

namespace tether {

struct LinearTrial {
  std::size_t loops = 1000;
  std::size_t periods = 600;  ///< the first third only settles
  std::uint64_t seed = 1;
};

/// Growth of E|z|² per period, from simulated loops with drawn losses instead of the operator of
/// mean_square_radius(). Near the edge the mean square is that of rare loops, which a plain average
/// does not have: hence a population whose members are resampled after each period in proportion
/// to |z|², while the mean growth is noted (Giardinà, Kurchan, Peliti: Direct evaluation of
/// large-deviation functions, Phys. Rev. Lett. 96, 2006). The error falls as 1/√(loops · periods),
/// the bias as 1/loops.
double simulated_radius(const LossChain& chain, const std::vector<LoopStep>& steps,
                        const LinearTrial& trial);

}  // namespace tether
