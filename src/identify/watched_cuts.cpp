#include "servosense/identify/watched_cuts.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include "dsp/dense.hpp"
#include "quick_stability.hpp"
#include "servosense/sim/run_parallel.hpp"

namespace servosense {
namespace {

/// A cut with its engagement.
struct Engaged {
  WatchedCut watched;
  MillingCut cut;
};

MillingCut engagement_of_watched(const WatchedCut& watched, MillingCut cut) {
  if (watched.radial_immersion_m) {
    cut.radial_immersion_m = *watched.radial_immersion_m;
    if (cut.direction == MillingDirection::slot && watched.direction.empty())
      cut.direction = MillingDirection::down;
  }
  if (watched.direction == "up") cut.direction = MillingDirection::up;
  if (watched.direction == "down") cut.direction = MillingDirection::down;
  if (watched.direction == "slot") cut.direction = MillingDirection::slot;
  return cut;
}

class Likelihood {
 public:
  Likelihood(std::span<const Engaged> cuts, const WatchedCutsConfig& config)
      : cuts_(cuts), config_(config) {}

  [[nodiscard]] double chatter_probability(double magnitude) const {
    const double growth = std::log(std::max(1e-300, magnitude));
    return config_.wrong_label +
           (1 - 2 * config_.wrong_label) / (1 + std::exp(-growth / config_.soft_margin));
  }
  [[nodiscard]] CriticalMultiplier multiplier(const UncertainCut::Possible& possible,
                                              std::size_t i) const {
    return quick_stability(possible, cuts_[i].cut)
        .critical_multiplier(cuts_[i].watched.spindle_speed_rpm, cuts_[i].watched.axial_depth_m);
  }
  /// Logarithm, of one cut.
  [[nodiscard]] double of(const UncertainCut::Possible& possible, std::size_t i) const {
    const WatchedCut& seen = cuts_[i].watched;
    const CriticalMultiplier m = multiplier(possible, i);
    const double chatter = chatter_probability(std::abs(m.multiplier));
    if (seen.stable) return std::log(1 - chatter);
    double sum = std::log(chatter);
    if (seen.chatter_hz) {
      const double deviation =
          std::max(config_.frequency_error_hz, config_.frequency_error * *seen.chatter_hz);
      const double off = (*seen.chatter_hz - m.chatter_frequency_hz) / deviation;
      sum += std::log((1 - config_.wrong_frequency) * std::exp(-0.5 * off * off) /
                          (deviation * std::sqrt(kTwoPi)) +
                      config_.wrong_frequency / config_.highest_frequency_hz);
    }
    return sum;
  }

 private:
  std::span<const Engaged> cuts_;
  const WatchedCutsConfig& config_;
};

/// Samples with their log-likelihoods, cut by cut.
struct Samples {
  Eigen::MatrixXd z;
  Eigen::MatrixXd log_likelihood;  ///< cut x sample
};

class Sampler {
 public:
  Sampler(const UncertainCut& cut, std::span<const Engaged> cuts, const WatchedCutsConfig& config)
      : cut_(cut), cuts_(cuts), config_(config), likelihood_(cuts, config) {
    samples_.z = prior_belief(cut, config.samples, config.seed);
    samples_.log_likelihood.setZero(static_cast<Eigen::Index>(cuts.size()), config.samples);
  }

  /// Takes in cut `i`.
  void take(std::size_t i) {
    const auto row = static_cast<Eigen::Index>(i);
    run_parallel(
        static_cast<std::size_t>(count()),
        [&](std::size_t s) {
          const auto column = static_cast<Eigen::Index>(s);
          samples_.log_likelihood(row, column) = likelihood_.of(cut_.at(samples_.z.col(column)), i);
        },
        config_.threads);
    double temper = 0;
    while (temper < 1) {
      const Eigen::VectorXd one = samples_.log_likelihood.row(row);
      double next = 1;
      if (effective_share(log_weight_ + (1 - temper) * one) < kLeastEffective) {
        double low = temper, high = 1;
        for (int k = 0; k < 40; ++k) {
          const double middle = 0.5 * (low + high);
          (effective_share(log_weight_ + (middle - temper) * one) < kLeastEffective ? high : low) =
              middle;
        }
        // Always on: a step too small would never end.
        next = std::max(low, std::min(1.0, temper + 1e-3));
      }
      log_weight_ += (next - temper) * one;
      least_effective_ = std::min(least_effective_, effective_share(log_weight_));
      temper = next;
      if (temper < 1 || effective_share(log_weight_) < kLeastEffective + 0.1) {
        draw_anew();
        move(i, temper);
      }
    }
  }

  /// Equal weights, for whoever uses the samples.
  CutsLearned finish() {
    if (effective_share(log_weight_) < 0.999) {
      draw_anew();
      if (!cuts_.empty()) move(cuts_.size() - 1, 1);
    }
    CutsLearned learned;
    learned.least_effective_share = least_effective_;
    learned.moved_share = moved_share_;
    learned.chatter_probability.resize(cuts_.size());
    run_parallel(
        cuts_.size(),
        [&](std::size_t i) {
          double sum = 0;
          for (Eigen::Index s = 0; s < count(); ++s)
            sum += likelihood_.chatter_probability(
                std::abs(likelihood_.multiplier(cut_.at(samples_.z.col(s)), i).multiplier));
          learned.chatter_probability[i] = sum / static_cast<double>(count());
        },
        config_.threads);
    learned.belief = std::move(samples_.z);
    return learned;
  }

 private:
  static constexpr double kLeastEffective = 0.5;

  [[nodiscard]] Eigen::Index count() const { return samples_.z.cols(); }

  [[nodiscard]] static double effective_share(const Eigen::VectorXd& log_weight) {
    const Eigen::ArrayXd w = (log_weight.array() - log_weight.maxCoeff()).exp();
    const double sum = w.sum();
    return sum * sum / (w.square().sum() * static_cast<double>(w.size()));
  }

  /// Systematic resampling.
  void draw_anew() {
    const Eigen::ArrayXd w = (log_weight_.array() - log_weight_.maxCoeff()).exp();
    const double step = w.sum() / static_cast<double>(count());
    double at = std::uniform_real_distribution<double>(0, step)(random_);
    Samples drawn = samples_;
    Eigen::Index from = 0;
    double sum = w[0];
    for (Eigen::Index s = 0; s < count(); ++s, at += step) {
      while (sum < at && from + 1 < count()) sum += w[++from];
      drawn.z.col(s) = samples_.z.col(from);
      drawn.log_likelihood.col(s) = samples_.log_likelihood.col(from);
    }
    samples_ = std::move(drawn);
    log_weight_.setZero();
  }

  /// Metropolis steps; cuts before `last` count in full, `last` as tempered.
  void move(std::size_t last, double temper) {
    const Eigen::Index d = samples_.z.rows();
    const Eigen::VectorXd mean = samples_.z.rowwise().mean();
    const Eigen::MatrixXd off = samples_.z.colwise() - mean;
    Eigen::MatrixXd covariance = off * off.transpose() / static_cast<double>(count());
    covariance.diagonal().array() += 1e-9;
    const Eigen::MatrixXd root = dense::cholesky_root(covariance);
    std::vector<char> moved(static_cast<std::size_t>(count()), 0);
    for (int pass = 0; pass < config_.moves; ++pass) {
      const std::uint64_t seed = random_();
      std::vector<char> accepted(moved.size(), 0);
      run_parallel(
          moved.size(),
          [&](std::size_t s) {
            std::mt19937_64 random(seed + 0x9e3779b97f4a7c15ULL * (s + 1));
            std::normal_distribution<double> normal;
            const auto column = static_cast<Eigen::Index>(s);
            Eigen::VectorXd step(d);
            for (double& x : step) x = normal(random);
            const Eigen::VectorXd z =
                samples_.z.col(column) + scale_ / std::sqrt(static_cast<double>(d)) * root * step;
            double left = std::log(std::uniform_real_distribution<double>(1e-300, 1)(random)) +
                          0.5 * (z.squaredNorm() - samples_.z.col(column).squaredNorm());
            const auto share = [&](std::size_t i) { return i == last ? temper : 1.0; };
            double before = 0;
            for (std::size_t i = 0; i <= last; ++i)
              before += share(i) * samples_.log_likelihood(static_cast<Eigen::Index>(i), column);
            left += before;  // what the new sum must reach
            const UncertainCut::Possible possible = cut_.at(z);
            Eigen::VectorXd now(static_cast<Eigen::Index>(last) + 1);
            double sum = 0;
            for (std::size_t k = 0; k <= last; ++k) {
              const std::size_t i = last - k;  // the newest is what most fail at
              const double l = likelihood_.of(possible, i);
              now[static_cast<Eigen::Index>(i)] = l;
              sum += share(i) * l;
              if (sum < left) return;  // none of the rest is above zero
            }
            samples_.z.col(column) = z;
            samples_.log_likelihood.col(column).head(now.size()) = now;
            accepted[s] = 1;
          },
          config_.threads);
      const double rate = static_cast<double>(std::count(accepted.begin(), accepted.end(), 1)) /
                          static_cast<double>(count());
      for (std::size_t s = 0; s < moved.size(); ++s) moved[s] |= accepted[s];
      scale_ = std::clamp(scale_ * std::exp(rate - 0.25), 0.05, 3.0);
    }
    moved_share_ = static_cast<double>(std::count(moved.begin(), moved.end(), 1)) /
                   static_cast<double>(count());
  }

  const UncertainCut& cut_;
  std::span<const Engaged> cuts_;
  const WatchedCutsConfig& config_;
  Likelihood likelihood_;
  Samples samples_;
  Eigen::VectorXd log_weight_ = Eigen::VectorXd::Zero(config_.samples);
  std::mt19937_64 random_{config_.seed};
  double scale_ = 2.38;  ///< of the steps (Roberts, Gelman and Gilks 1997), then by acceptance
  double least_effective_ = 1;
  double moved_share_ = 1;
};

}  // namespace

Expected<CutsLearned> learn_from_cuts(const UncertainCut& cut, std::span<const WatchedCut> cuts,
                                      const WatchedCutsConfig& config) {
  std::vector<Engaged> engaged;
  for (const WatchedCut& watched : cuts) {
    engaged.push_back({watched, engagement_of_watched(watched, cut.cut())});
    if (auto sd = SemiDiscretization::create(cut.structure(), cut.tool(), engaged.back().cut); !sd)
      return sd.error();
  }
  Sampler sampler(cut, engaged, config);
  double work = 0, all = 0;
  for (std::size_t i = 0; i < cuts.size(); ++i) all += static_cast<double>(i + 1);
  for (std::size_t i = 0; i < cuts.size(); ++i) {
    sampler.take(i);
    work += static_cast<double>(i + 1);
    if (config.progress) config.progress(work / all);
  }
  CutsLearned learned = sampler.finish();
  if (learned.moved_share < 0.1)
    return data_error(
        "The cuts contradict each other or the machine file, so that nothing can be learned from "
        "them together: look for a wrong line, or state larger errors in the machine file.");
  return learned;
}

}  // namespace servosense
