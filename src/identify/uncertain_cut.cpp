#include "servosense/identify/uncertain_cut.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "dsp/dense.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "student_quantile.hpp"

namespace servosense {
namespace {

constexpr Eigen::Index kTangentialAt = 0, kRatioAt = 1, kModesAt = 2;

/// Standard normal quantile of a share 0..1.
double normal_at(double share) {
  const double tail = std::clamp(std::min(share, 1 - share), 1e-12, 0.5);
  return share < 0.5 ? -normal_quantile(tail) : normal_quantile(tail);
}

}  // namespace

Expected<UncertainCut> UncertainCut::create(const Structure& structure, const MillingTool& tool,
                                            const MillingCut& cut, const CutErrors& errors) {
  if (auto sd = SemiDiscretization::create(structure, tool, cut); !sd) return sd.error();
  if (errors.x.size() != structure.x.size() || errors.y.size() != structure.y.size())
    return data_error(
        "The modes and their relative errors differ in number: give one triple of errors a mode.");
  UncertainCut known;
  known.structure_ = structure;
  known.tool_ = tool;
  known.cut_ = cut;
  known.offset_m_ = errors.offset_m;
  std::vector<double> deviation = {errors.tangential, errors.radial_ratio};
  known.parameters_ = {{"tangential_coefficient_N_per_m2", Measurement::feeds},
                       {"radial_ratio", Measurement::forces}};
  for (const bool along_x : {true, false}) {
    const auto& triples = along_x ? errors.x : errors.y;
    for (std::size_t i = 0; i < triples.size(); ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        constexpr std::array<const char*, 3> kNames = {"natural_frequency_hz", "damping_ratio",
                                                       "modal_mass_kg"};
        deviation.push_back(triples[i][k]);
        known.parameters_.push_back({std::string(kNames[k]) + " of mode " + std::to_string(i + 1) +
                                         (along_x ? " in x" : " in y"),
                                     along_x ? Measurement::hits_x : Measurement::hits_y});
      }
  }
  for (const double d : deviation)
    if (!(d >= 0) || !std::isfinite(d)) return data_error("Standard errors must be zero or above.");
  known.spread_ = Eigen::Map<const Eigen::VectorXd>(deviation.data(),
                                                    static_cast<Eigen::Index>(deviation.size()))
                      .asDiagonal();
  return known;
}

Expected<UncertainCut> UncertainCut::without_structure(const MillingTool& tool,
                                                       const MillingCut& cut,
                                                       const CutErrors& errors) {
  using namespace unknown_structure;
  const double w = kTwoPi * kFrequency_hz.median;
  const StructuralMode mode{kFrequency_hz.median, kDamping.median,
                            kStiffness_N_per_m.median / (w * w)};
  CutErrors all = errors;
  all.x.assign(1, {});
  all.y.assign(1, {});
  auto known = create({{mode}, {mode}}, tool, cut, all);
  if (!known) return known.error();
  known->unknown_ = true;
  // z: what both directions share of frequency, damping and stiffness, then how they differ.
  Eigen::MatrixXd& s = known->spread_;
  for (const bool along_x : {true, false}) {
    const Eigen::Index at = kModesAt + (along_x ? 0 : 3);
    const double half = along_x ? 0.5 : -0.5;
    s.block(at, kModesAt, 3, 6).setZero();
    s(at, kModesAt) = kFrequency_hz.deviation;
    s(at, kModesAt + 3) = half * kFrequencyBetween;
    s(at + 1, kModesAt + 1) = kDamping.deviation;
    s(at + 1, kModesAt + 4) = half * kDampingBetween;
    s(at + 2, kModesAt + 2) = kStiffness_N_per_m.deviation;
    s(at + 2, kModesAt + 5) = half * kStiffnessBetween;
    s.row(at + 2) -= 2 * s.row(at);  // m = k / w^2
  }
  return known;
}

UncertainCut::Possible UncertainCut::at(const Eigen::Ref<const Eigen::VectorXd>& z) const {
  const Eigen::VectorXd theta = spread_ * z;
  Possible p{structure_, tool_};
  p.tool.force.tangential_coefficient_N_per_m2 *= std::exp(theta[kTangentialAt]);
  p.tool.force.radial_ratio = std::max(0.0, p.tool.force.radial_ratio + theta[kRatioAt]);
  Eigen::Index i = kModesAt;
  for (auto* modes : {&p.structure.x, &p.structure.y})
    for (StructuralMode& m : *modes) {
      m.natural_frequency_hz *= std::exp(theta[i++]);
      m.damping_ratio *= std::exp(theta[i++]);
      m.modal_mass_kg *= std::exp(theta[i++]);
    }
  return p;
}

CutBelief prior_belief(const UncertainCut& cut, Eigen::Index count, std::uint64_t seed) {
  const Eigen::Index d = cut.size();
  double root = 2;  // of x^(d+1) = x + 1
  for (int i = 0; i < 100; ++i) root = std::pow(1 + root, 1 / static_cast<double>(d + 1));
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform;
  CutBelief belief(d, count);
  for (Eigen::Index j = 0; j < d; ++j) {
    const double step = std::pow(root, -static_cast<double>(j + 1));
    const double shift = uniform(random);
    for (Eigen::Index i = 0; i < count; ++i) {
      double whole = 0;
      belief(j, i) = normal_at(std::modf(shift + step * static_cast<double>(i + 1), &whole));
    }
  }
  return belief;
}

CutBelief belief_if_known(const UncertainCut& cut, const CutBelief& belief,
                          const std::vector<bool>& known) {
  std::vector<Eigen::Index> rows;
  for (std::size_t i = 0; i < known.size(); ++i)
    if (known[i]) rows.push_back(static_cast<Eigen::Index>(i));
  const Eigen::VectorXd mean = belief.rowwise().mean();
  const Eigen::MatrixXd off = belief.colwise() - mean;
  const Eigen::MatrixXd theta = cut.spread()(rows, Eigen::all) * off;
  const double scale = 1 / static_cast<double>(belief.cols());
  const Eigen::MatrixXd within = scale * theta * theta.transpose();
  const Eigen::MatrixXd across = scale * off * theta.transpose();
  // Rank-revealing: an error of zero has nothing to take away.
  return belief - across * dense::least_norm(within, theta);
}

}  // namespace servosense
