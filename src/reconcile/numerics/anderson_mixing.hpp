// Where a map comes to rest that feeds its answer back: Anderson mixing of all rounds so far.
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace servosense::reconcile {

/// Anderson (1965): of all force inputs tried and what came out of each, the mix that settles best.
/// For a linear cut as good as GMRES, also where plain rounds run away.
class AndersonMixing {
 public:
  Eigen::VectorXd next(const Eigen::VectorXd& in, const Eigen::VectorXd& out) {
    const Eigen::VectorXd off = out - in;
    if (last_out_.size() > 0) {
      // Changes of what is left over, at right angles to those before, and of what came out.
      Eigen::VectorXd off_change = off - last_off_, out_change = out - last_out_;
      for (std::size_t k = 0; k < off_changes_.size(); ++k) {
        const double part = off_changes_[k].dot(off_change);
        off_change -= part * off_changes_[k];
        out_change -= part * out_changes_[k];
      }
      if (const double size = off_change.norm(); size > 0) {
        off_changes_.emplace_back(off_change / size);
        out_changes_.emplace_back(out_change / size);
      }
    }
    last_out_ = out;
    last_off_ = off;
    Eigen::VectorXd mixed = out;
    for (std::size_t k = 0; k < off_changes_.size(); ++k)
      mixed -= off_changes_[k].dot(off) * out_changes_[k];
    return mixed;
  }

 private:
  Eigen::VectorXd last_out_, last_off_;
  std::vector<Eigen::VectorXd> off_changes_, out_changes_;
};

}  // namespace servosense::reconcile
