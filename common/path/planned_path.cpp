#include "common/path/planned_path.hpp"

namespace tether {

PathPoint PlannedPath::point(const SpeedProfile::Motion& motion) const {
  const CurvePoint p = curve_->at(motion.s_m);
  return {p.x_m, p.y_m, p.yaw_rad, motion.v_mps, motion.v_mps * p.curvature_1pm};
}

}  // namespace tether
