// A controller of one's own for Tether: a proportional law that follows scenarios/paper.toml's
// figure eight, by poses alone. docs/reference/time.md says how to start it; controller.py is one
// by the Python package.
#include <cmath>
#include <tether/law_client.hpp>

namespace {

/// Forward speed and yaw rate towards where the path is in two seconds.
void law(const tether::pose_t& pose, tether::twist_t& command) {
  const double angle = 0.1 * (1e-6 * static_cast<double>(pose.utime) + 2.0);
  const double u = 20.0 * std::sin(angle), w = u * std::cos(angle);
  const double dx = (u + w) * std::sqrt(0.5) - pose.x_m, dy = (w - u) * std::sqrt(0.5) - pose.y_m;
  const double heading_error = std::remainder(std::atan2(dy, dx) - pose.yaw_rad, 2.0 * M_PI);
  command.v_mps = 0.495 * std::sqrt(dx * dx + dy * dy);
  command.omega_radps = 0.6 * heading_error;
}

}  // namespace

int main(int argc, char** argv) { return tether::control(argc, argv, law); }
