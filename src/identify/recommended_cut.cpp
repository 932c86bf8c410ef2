#include "servosense/identify/recommended_cut.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <utility>

#include "feed_under_limits.hpp"
#include "quick_stability.hpp"
#include "servosense/sim/run_parallel.hpp"

namespace servosense {
namespace {

/// Columns spread evenly over the belief.
CutBelief some_of(const CutBelief& belief, Eigen::Index count, Eigen::Index from = 0) {
  count = std::min(count, belief.cols());
  CutBelief some(belief.rows(), count);
  for (Eigen::Index s = 0; s < count; ++s)
    some.col(s) = belief.col((from + s * belief.cols() / count) % belief.cols());
  return some;
}

class Recommender {
 public:
  Recommender(const UncertainCut& cut, const CutBelief& belief, const CutLimits& limits,
              const RecommendConfig& config)
      : cut_(cut),
        belief_(belief),
        limits_(limits),
        config_(config),
        feed_(cut, belief, limits, config.probability) {}

  Recommendation run() {
    Recommendation r;
    const double ratio = limits_.greatest_rpm / limits_.least_rpm;
    const int count = ratio > 1 + 1e-9 ? config_.speeds : 1;
    for (int i = 0; i < count; ++i)
      r.spindle_speed_rpm.push_back(
          limits_.least_rpm *
          (count > 1 ? std::pow(ratio, static_cast<double>(i) / (count - 1)) : 1));
    const CutBelief map_belief = some_of(belief_, config_.map_samples);
    const Eigen::MatrixXd unsorted = limit_depths(r.spindle_speed_rpm, map_belief, kRough, 0.5);
    r.limit_depth_m = sorted(unsorted);
    std::vector<double> removal;
    for (std::size_t i = 0; i < r.spindle_speed_rpm.size(); ++i) {
      r.depth_m.push_back(deepest_at(r.limit_depth_m.row(static_cast<Eigen::Index>(i))));
      removal.push_back(feed_.best(r.spindle_speed_rpm[i], r.depth_m.back()).removal_m3_s);
    }
    choose(r, removal);
    r.removal_if_known_m3_s = expected_if_known(r.spindle_speed_rpm, unsorted);
    if (r.cut && config_.gains) {
      find_gains(r, removal);
      find_next_cut(r, unsorted);
    }
    if (config_.progress) config_.progress(1);
    return r;
  }

 private:
  /// Of a limit depth, of it: beside what samples differ by, and where the advice comes from.
  static constexpr double kRough = 0.01, kFine = 0.002;

  /// Row a speed, column a sample.
  Eigen::MatrixXd limit_depths(const std::vector<double>& speeds, const CutBelief& belief,
                               double tolerance, double share_of_work = 0) {
    // The middle of the belief first: a guess for all others.
    const std::vector<double> middle = limits_of(belief.rowwise().mean(), speeds, {}, tolerance);
    Eigen::MatrixXd depth(static_cast<Eigen::Index>(speeds.size()), belief.cols());
    std::atomic<std::size_t> done = 0;
    const double before = progress_;
    run_parallel(
        static_cast<std::size_t>(belief.cols()),
        [&](std::size_t s) {
          const auto column = static_cast<Eigen::Index>(s);
          const std::vector<double> own = limits_of(belief.col(column), speeds, middle, tolerance);
          depth.col(column) =
              Eigen::Map<const Eigen::VectorXd>(own.data(), static_cast<Eigen::Index>(own.size()));
          if (config_.progress && share_of_work > 0)
            config_.progress(before + share_of_work * static_cast<double>(++done) /
                                          static_cast<double>(belief.cols()));
        },
        config_.threads);
    progress_ += share_of_work;
    return depth;
  }

  std::vector<double> limits_of(const Eigen::Ref<const Eigen::VectorXd>& z,
                                const std::vector<double>& speeds, const std::vector<double>& guess,
                                double tolerance) const {
    const SemiDiscretization stability = quick_stability(cut_.at(z), cut_.cut());
    std::vector<double> depth;
    double off = 1;  // of the guess, at the speed before
    for (std::size_t i = 0; i < speeds.size(); ++i) {
      if (guess.empty()) {
        depth.push_back(stability.limit_at(speeds[i], limits_.axial_depth_m, 40).axial_depth_m);
        continue;
      }
      const double here = std::min(guess[i], limits_.axial_depth_m);
      depth.push_back(
          limit_near(stability, speeds[i], off * here, limits_.axial_depth_m, tolerance));
      if (std::isfinite(depth.back())) off = std::clamp(depth.back() / here, 0.1, 10.0);
    }
    return depth;
  }

  static Eigen::MatrixXd sorted(Eigen::MatrixXd depth) {
    for (Eigen::Index i = 0; i < depth.rows(); ++i) {
      Eigen::VectorXd row = depth.row(i);
      std::sort(row.begin(), row.end());
      depth.row(i) = row;
    }
    return depth;
  }

  /// Deepest cut that enough of the samples bear, their limits rising; the depth allowed at most.
  [[nodiscard]] double deepest_at(const Eigen::Ref<const Eigen::RowVectorXd>& limits) const {
    const auto unstable = static_cast<Eigen::Index>(
        std::floor((1 - config_.probability) * static_cast<double>(limits.size()) + 1e-9));
    return std::min(limits[std::min(unstable, limits.size() - 1)], limits_.axial_depth_m);
  }

  /// Around the speeds that promise most, with more samples; the best with all of them.
  void choose(Recommendation& r, const std::vector<double>& removal) {
    constexpr std::size_t kPlaces = 3;
    constexpr int kBetween = 2;  // speeds on each side, up to the next of the map
    std::vector<double> speeds;
    const std::vector<std::size_t> best = best_places(removal, kPlaces);
    const double step = r.spindle_speed_rpm.size() > 1
                            ? std::log(r.spindle_speed_rpm[1] / r.spindle_speed_rpm[0])
                            : 0;
    for (const std::size_t place : best)
      for (int k = -kBetween; k <= kBetween; ++k) {
        if (step == 0 && k != 0) continue;
        speeds.push_back(
            std::clamp(r.spindle_speed_rpm[place] * std::exp(step * k / (kBetween + 1)),
                       limits_.least_rpm, limits_.greatest_rpm));
      }
    std::sort(speeds.begin(), speeds.end());
    constexpr Eigen::Index kSamples = 300;
    const Eigen::MatrixXd limits = sorted(limit_depths(
        speeds, some_of(belief_, kSamples, belief_.cols() / (2 * kSamples)), kRough, 0.2));
    std::size_t at = 0;
    double most = 0;
    for (std::size_t i = 0; i < speeds.size(); ++i) {
      const double removed =
          feed_.best(speeds[i], deepest_at(limits.row(static_cast<Eigen::Index>(i)))).removal_m3_s;
      if (removed > most) {
        most = removed;
        at = i;
      }
    }
    const double speed_rpm = speeds[at];
    const Eigen::MatrixXd all = sorted(limit_depths({speed_rpm}, belief_, kFine, 0.1));
    const double deepest_m = deepest_at(all.row(0));
    const FeedAndDepth chosen = feed_.best(speed_rpm, deepest_m);
    if (!(chosen.removal_m3_s > 0)) {
      r.why_not = "no feed is left by run-out, torque, power and deflection at any stable depth";
      return;
    }
    AdvisedCut advised;
    advised.spindle_speed_rpm = speed_rpm;
    advised.axial_depth_m = chosen.axial_depth_m;
    advised.feed_per_tooth_m = chosen.feed_per_tooth_m;
    advised.removal_m3_s = chosen.removal_m3_s;
    advised.probability_stable = probability_at(speed_rpm, chosen.axial_depth_m);
    advised.limits = feed_.at(
        speed_rpm, chosen, chosen.axial_depth_m >= deepest_m && deepest_m < limits_.axial_depth_m);
    r.cut = std::move(advised);
  }

  /// Share of all samples that are stable at that very cut.
  [[nodiscard]] double probability_at(double spindle_speed_rpm, double axial_depth_m) const {
    std::vector<char> stable(static_cast<std::size_t>(belief_.cols()), 0);
    run_parallel(
        stable.size(),
        [&](std::size_t s) {
          stable[s] =
              quick_stability(cut_.at(belief_.col(static_cast<Eigen::Index>(s))), cut_.cut())
                  .spectral_radius(spindle_speed_rpm, axial_depth_m) < 1;
        },
        config_.threads);
    return static_cast<double>(std::accumulate(stable.begin(), stable.end(), 0)) /
           static_cast<double>(stable.size());
  }

  /// Local maxima first, the largest first.
  static std::vector<std::size_t> best_places(const std::vector<double>& removal,
                                              std::size_t count) {
    std::vector<std::size_t> places(removal.size());
    std::iota(places.begin(), places.end(), 0U);
    std::sort(places.begin(), places.end(),
              [&](std::size_t a, std::size_t b) { return removal[a] > removal[b]; });
    std::vector<std::size_t> chosen;
    for (const std::size_t p : places) {
      const bool taken = std::any_of(chosen.begin(), chosen.end(), [&](std::size_t c) {
        return std::max(c, p) - std::min(c, p) <= 1;
      });
      if (!taken && chosen.size() < count) chosen.push_back(p);
    }
    return chosen;
  }

  /// Mean of what each sample would allow if one knew that it is the true one.
  [[nodiscard]] double expected_if_known(const std::vector<double>& speeds,
                                         const Eigen::MatrixXd& limits) const {
    double sum = 0;
    for (Eigen::Index s = 0; s < limits.cols(); ++s) {
      double most = 0;
      for (std::size_t i = 0; i < speeds.size(); ++i)
        most = std::max(most, quick_removal(speeds[i], limits(static_cast<Eigen::Index>(i), s)));
      sum += most;
    }
    return sum / static_cast<double>(limits.cols());
  }

  /// As FeedUnderLimits::best, from a table: it is asked very often.
  [[nodiscard]] double quick_removal(double speed_rpm, double limit_m) const {
    return feed_.best(speed_rpm, std::min(limit_m, limits_.axial_depth_m)).removal_m3_s;
  }

  void find_gains(Recommendation& r, const std::vector<double>& removal) {
    // Where the middle of the belief, or its certain part, removes most.
    std::vector<double> promise = removal;
    for (std::size_t i = 0; i < promise.size(); ++i) {
      const auto row = r.limit_depth_m.row(static_cast<Eigen::Index>(i));
      promise[i] += quick_removal(r.spindle_speed_rpm[i], row[row.size() / 2]);
    }
    std::vector<double> speeds;
    for (const std::size_t place : best_places(promise, 16))
      speeds.push_back(r.spindle_speed_rpm[place]);
    std::sort(speeds.begin(), speeds.end());
    const CutBelief some = some_of(belief_, 100);
    const auto best_of = [&](const CutBelief& belief) {
      const Eigen::MatrixXd limits = sorted(limit_depths(speeds, belief, kRough, 0.04));
      double most = 0;
      for (std::size_t i = 0; i < speeds.size(); ++i)
        most = std::max(most,
                        feed_.best(speeds[i], deepest_at(limits.row(static_cast<Eigen::Index>(i))))
                            .removal_m3_s);
      return most;
    };
    const double now = best_of(some);
    if (!(now > 0)) return;
    const auto known = [&](std::initializer_list<Measurement> told) {
      std::vector<bool> which;
      for (const UncertainParameter& p : cut_.parameters())
        which.push_back(std::find(told.begin(), told.end(), p.told_by) != told.end());
      return which;
    };
    const auto add = [&](const char* what, std::initializer_list<Measurement> told) {
      const std::vector<bool> which = known(told);
      if (std::find(which.begin(), which.end(), true) == which.end()) return;
      r.gains.push_back({what, best_of(belief_if_known(cut_, some, which)) / now - 1});
    };
    add("cuts at several feeds for the tangential coefficient (identify cutting)",
        {Measurement::feeds});
    add("forces in two directions for the radial ratio (identify cutting)", {Measurement::forces});
    if (cut_.structure_is_unknown()) {
      add("a hammer test along x and y (identify impact, identify modes)",
          {Measurement::hits_x, Measurement::hits_y});
    } else {
      add("more hits along x (identify impact, identify modes)", {Measurement::hits_x});
      add("more hits along y (identify impact, identify modes)", {Measurement::hits_y});
    }
    std::stable_sort(
        r.gains.begin(), r.gains.end(),
        [](const MeasurementGain& a, const MeasurementGain& b) { return a.gain > b.gain; });
  }

  /// Of every speed and of depths between the certain and the hopeless, what the best cut would
  /// remove after either outcome, the outcomes weighed by their probability.
  void find_next_cut(Recommendation& r, const Eigen::MatrixXd& limits) {
    const Eigen::Index samples = limits.cols();
    const std::size_t speeds = r.spindle_speed_rpm.size();
    std::vector<std::vector<Eigen::Index>> rising(speeds);
    for (std::size_t i = 0; i < speeds; ++i) {
      rising[i].resize(static_cast<std::size_t>(samples));
      std::iota(rising[i].begin(), rising[i].end(), 0);
      const auto row = limits.row(static_cast<Eigen::Index>(i));
      std::sort(rising[i].begin(), rising[i].end(),
                [&](Eigen::Index a, Eigen::Index b) { return row[a] < row[b]; });
    }
    const auto best_after = [&](const Eigen::VectorXd& weight) {
      const double enough = (1 - config_.probability) * weight.sum();
      double most = 0;
      for (std::size_t i = 0; i < speeds; ++i) {
        double sum = 0, depth_m = limits_.axial_depth_m;
        for (const Eigen::Index s : rising[i]) {
          sum += weight[s];
          if (sum <= enough) continue;
          depth_m = std::min(depth_m, limits(static_cast<Eigen::Index>(i), s));
          break;
        }
        if (upper_bound(r.spindle_speed_rpm[i], depth_m) <= most) continue;
        most = std::max(most, quick_removal(r.spindle_speed_rpm[i], depth_m));
      }
      return most;
    };
    const double now = best_after(Eigen::VectorXd::Ones(samples));
    std::vector<TestCut> tests;
    for (std::size_t i = 0; i < speeds; ++i)
      for (const double chance : {0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3}) {
        const double depth_m =
            r.limit_depth_m(static_cast<Eigen::Index>(i),
                            static_cast<Eigen::Index>((1 - chance) * static_cast<double>(samples)));
        if (depth_m < limits_.axial_depth_m)
          tests.push_back({r.spindle_speed_rpm[i], depth_m, chance, 0});
      }
    run_parallel(
        tests.size(),
        [&](std::size_t t) {
          TestCut& test = tests[t];
          const auto row = std::lower_bound(r.spindle_speed_rpm.begin(), r.spindle_speed_rpm.end(),
                                            test.spindle_speed_rpm) -
                           r.spindle_speed_rpm.begin();
          constexpr double kSoft = 0.03;  // of the depth: as sharp as a label tells
          Eigen::VectorXd stable(samples);
          for (Eigen::Index s = 0; s < samples; ++s)
            stable[s] = 1 / (1 + std::exp((test.axial_depth_m / limits(row, s) - 1) / kSoft));
          const double share = stable.mean();
          const Eigen::VectorXd chatter = 1 - stable.array();
          const double expected =
              share * std::max(now, best_after(stable)) + (1 - share) * best_after(chatter);
          test.probability_stable = share;
          test.gain = expected / now - 1;
        },
        config_.threads);
    const auto best =
        std::max_element(tests.begin(), tests.end(),
                         [](const TestCut& a, const TestCut& b) { return a.gain < b.gain; });
    if (best != tests.end() && now > 0) r.next_cut = *best;
  }

  /// Of what can be removed.
  [[nodiscard]] double upper_bound(double speed_rpm, double depth_m) const {
    return limits_.feed_per_tooth_m * depth_m * cut_.tool().diameter_m * cut_.tool().teeth *
           speed_rpm / 60;
  }

  const UncertainCut& cut_;
  const CutBelief& belief_;
  CutLimits limits_;
  const RecommendConfig& config_;
  FeedUnderLimits feed_;
  double progress_ = 0;
};

}  // namespace

double Recommendation::probability(std::size_t speed, double axial_depth_m) const {
  const Eigen::VectorXd row = limit_depth_m.row(static_cast<Eigen::Index>(speed));
  const auto first = std::upper_bound(row.begin(), row.end(), axial_depth_m);
  return static_cast<double>(row.end() - first) / static_cast<double>(row.size());
}

Expected<Recommendation> recommend_cut(const UncertainCut& cut, const CutBelief& belief,
                                       const CutLimits& limits, const RecommendConfig& config) {
  if (!(config.probability >= 0.5 && config.probability <= 0.999))
    return usage_error("The probability must lie between 0.5 and 0.999.");
  if (!(limits.least_rpm > 0) || !(limits.greatest_rpm >= limits.least_rpm))
    return data_error(
        "The limits leave no spindle speed: the least must be above zero and not above the "
        "greatest.");
  if (!(limits.feed_per_tooth_m > 0) || !(limits.axial_depth_m > 0))
    return data_error("The limits of feed per tooth and axial depth must be above zero.");
  if (belief.cols() < 20 || belief.rows() != cut.size())
    return usage_error("A belief needs 20 samples at least, one number for each parameter.");
  return Recommender(cut, belief, limits, config).run();
}

}  // namespace servosense
