#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace tether {

/// The variance of a mean of correlated samples, of whose correlation nothing is known.
///
/// Non-overlapping batch means whose batch size doubles: 32 to 64 batches at any time, so memory is
/// bounded, each sample costs O(1), and once batches are long against the correlation time their
/// means are independent (Law & Kelton, Simulation Modeling and Analysis, section 9.5.3; a
/// Newey–West estimate would need a bandwidth chosen beforehand, and as many products per sample).
///
/// A sample is a vector of `kDimension` whole numbers, so that functions of several means get their
/// variance from the means' covariances.
template <std::size_t kDimension>
class BatchMeans {
 public:
  using Sample = std::array<std::int64_t, kDimension>;
  static constexpr std::size_t kMostBatches = 64;

  void add(const Sample& sample) {
    for (std::size_t i = 0; i < kDimension; ++i) current_[i] += sample[i];
    if (++in_current_ < batch_size_) return;
    batches_.push_back(current_);
    current_ = {};
    in_current_ = 0;
    if (batches_.size() == kMostBatches) merge_pairs();
  }

  /// Complete batches.
  std::size_t batches() const { return batches_.size(); }
  std::int64_t batch_size() const { return batch_size_; }

  /// n·Var of the mean of Σ weights[i]·sample[i], by the scatter of the complete batches; 0 below
  /// two batches.
  double asymptotic_variance(const std::array<double, kDimension>& weights) const {
    if (batches_.size() < 2) return 0.0;
    const std::vector<double> means = batch_means(weights);
    return static_cast<double>(batch_size_) * scatter(means) /
           static_cast<double>(means.size() - 1);
  }

  /// The lag-1 correlation of successive batch means; near 0 (within 2.33/√batches in 99 % of all
  /// cases) if batches are long enough.
  double batch_correlation(const std::array<double, kDimension>& weights) const {
    const std::vector<double> means = batch_means(weights);
    const double square_sum = scatter(means);
    if (!(square_sum > 0.0)) return 0.0;
    double products = 0.0;
    const double centre = mean(means);
    for (std::size_t i = 1; i < means.size(); ++i) {
      products += (means[i] - centre) * (means[i - 1] - centre);
    }
    return products / square_sum;
  }

 private:
  static double mean(const std::vector<double>& values) {
    double sum = 0.0;
    for (double v : values) sum += v;
    return sum / static_cast<double>(values.size());
  }
  static double scatter(const std::vector<double>& values) {
    double sum = 0.0;
    const double centre = mean(values);
    for (double v : values) sum += (v - centre) * (v - centre);
    return sum;
  }
  std::vector<double> batch_means(const std::array<double, kDimension>& weights) const {
    std::vector<double> means;
    for (const Sample& batch : batches_) {
      double sum = 0.0;
      for (std::size_t i = 0; i < kDimension; ++i) {
        sum += weights[i] * static_cast<double>(batch[i]);
      }
      means.push_back(sum / static_cast<double>(batch_size_));
    }
    return means;
  }
  void merge_pairs() {
    for (std::size_t b = 0; b < kMostBatches / 2; ++b) {
      for (std::size_t i = 0; i < kDimension; ++i) {
        batches_[b][i] = batches_[2 * b][i] + batches_[2 * b + 1][i];
      }
    }
    batches_.resize(kMostBatches / 2);
    batch_size_ *= 2;
  }

  std::vector<Sample> batches_;
  Sample current_{};
  std::int64_t in_current_ = 0;
  std::int64_t batch_size_ = 1;
};

}  // namespace tether
