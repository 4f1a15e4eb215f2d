#pragma once

#include <istream>
#include <string>
#include <vector>

namespace tether {

/// The best look-ahead τ by packet reception ratio and delay, from the means of a sweep: a CSV with
/// columns channel.prr, channel.delay_ms (optional: then 0), controller.tau_s and epsilon_m. Rows
/// with one PRR and delay are candidates of which the one with the least ε is chosen; several rows
/// of one candidate (the seeds of a sweep) are averaged, empty values of ε (failed runs) left out.
///
///   tether sweep experiments/tau_table.toml && tether sweep export out/tau_table --means
class TauTable {
 public:
  /// `name` stands for the file in messages. Throws UsageError for what is missing or no number.
  static TauTable read(std::istream& in, const std::string& name);

  /// τ for a network as estimated: linear between the table's PRRs and delays, which need to be a
  /// grid; the nearest edge outside.
  double tau_s(double prr, double delay_ms) const;

 private:
  double at(std::size_t prr, std::size_t delay) const {
    return tau_s_[prr * delays_ms_.size() + delay];
  }

  std::vector<double> prrs_;       ///< ascending
  std::vector<double> delays_ms_;  ///< ascending
  std::vector<double> tau_s_;      ///< by PRR, then delay
};

}  // namespace tether
