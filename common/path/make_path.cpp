#include "common/path/make_path.hpp"

#include "common/path/figure_eight.hpp"
#include "common/path/planned_path.hpp"

namespace tether {

std::shared_ptr<const ReferencePath> make_path(const Scenario::Path& config) {
  if (auto planned = plan_path(config)) return planned;
  return std::make_shared<FigureEight>(config.figure_eight);
}

}  // namespace tether
