// Where in their bins the samples of a level fell. The mean over a bin of a force that steps within
// it goes with the number of samples on either side: a bin is cut in parts at the steps, and each
// part stands at the mean angle of its samples, exact where the force is straight.
#pragma once

#include <Eigen/Dense>
#include <cstddef>
#include <vector>

namespace servosense::reconcile {

class BinnedAngles {
 public:
  BinnedAngles() = default;
  /// Angles within one turn, in any order.
  BinnedAngles(std::vector<double> angles_rad, std::size_t bins);

  /// Of the samples in each bin; its middle where there are none.
  [[nodiscard]] const std::vector<double>& means() const { return mean_rad_; }

  /// Bins, those with a break in several parts.
  struct Parts {
    std::vector<double> angle_rad;  ///< rising
    std::vector<double> share;      ///< of the samples of the bin
    std::vector<Eigen::Index> bin;
    /// From the parts to the bins; rows: x of all, then y.
    [[nodiscard]] Eigen::MatrixXd over_bins(const Eigen::MatrixXd& columns,
                                            Eigen::Index bins) const;
  };
  /// Breaks: any angles.
  [[nodiscard]] Parts cut_at(std::vector<double> breaks_rad) const;

 private:
  std::vector<double> angle_rad_;   // rising
  std::vector<double> sum_before_;  // of the angles
  std::vector<std::size_t> begin_;  // of each bin, and the end
  std::vector<double> mean_rad_;
};

}  // namespace servosense::reconcile
