#include "common/make_path.hpp"

#include "common/figure_eight.hpp"

namespace tether {

std::shared_ptr<const ReferencePath> make_path(const Scenario::Path& config) {
  return std::make_shared<FigureEight>(config.figure_eight);
}

}  // namespace tether
