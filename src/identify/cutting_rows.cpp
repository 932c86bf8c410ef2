#include "cutting_rows.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "dsp/dense.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/average_cutting.hpp"

namespace servosense::cutting_rows {
namespace {

using Kind = CuttingSignal::Kind;

constexpr double kSameSpeed = 0.04;  // of the speed: one friction
constexpr double kExact = 1e-9;      // of the largest mean: less than a double's sums leave
constexpr double kSingular = 1e-7;   // of the largest singular value

Shares shares_of(const AverageShare& a) {
  return {a.tangential, a.tangential_edge, a.radial, a.radial_edge, a.axial, a.axial_edge};
}

/// Of what a signal reads in a cut.
Shares shares_of(Kind kind, const CutGeometry& g, const FoundCut& cut) {
  const AverageCutting average = average_cutting(g.teeth, g.radius_m, g.axial_depth_m,
                                                 cut.feed_per_tooth_m, g.engagement, g.throw_m);
  if (kind == Kind::torque) return shares_of(average.torque);
  if (kind == Kind::z) return shares_of(average.z);
  // The cutter's frame, x along the feed, y to its left where the spindle turns right.
  const Shares along = shares_of(average.x), left = shares_of(average.y);
  const double turn = cut.speed_rad_s < 0 ? -1 : 1;
  const auto [ux, uy] = cut.direction;
  Shares all{};
  for (std::size_t c = 0; c < kCoefficients; ++c)
    all[c] =
        kind == Kind::x ? along[c] * ux - left[c] * uy * turn : along[c] * uy + left[c] * ux * turn;
  return all;
}

double velocity_of(const CuttingSignal& signal, const FoundCut& cut) {
  return signal.kind == Kind::torque ? std::abs(cut.speed_rad_s)
                                     : cut.velocity_m_s[static_cast<std::size_t>(signal.kind) - 1];
}

/// Where friction is another: a spindle at another speed, an axis the other way.
class Groups {
 public:
  int of(const CuttingSignal& signal, const FoundCut& cut) {
    if (!signal.is_drive) return 0;
    const double v = velocity_of(signal, cut);
    if (signal.kind != Kind::torque) return std::abs(v) < kStill_m_s ? 0 : v > 0 ? 1 : -1;
    for (std::size_t g = 0; g < speeds_.size(); ++g)
      if (std::abs(v - speeds_[g]) <= kSameSpeed * speeds_[g]) return static_cast<int>(g);
    speeds_.push_back(v);
    return static_cast<int>(speeds_.size()) - 1;
  }

 private:
  std::vector<double> speeds_;
};

bool stands(const CuttingSignal& signal, const FoundCut& cut) {
  return signal.is_drive && signal.kind != Kind::torque &&
         std::abs(velocity_of(signal, cut)) < kStill_m_s;
}

}  // namespace

Equations equations(const Sensor& sensor, const CutGeometry& geometry,
                    const std::vector<CuttingRecord>& records, const std::vector<FoundCut>& cuts) {
  using Key = std::tuple<std::string, int, std::size_t>;  // signal, group, record
  Equations e;
  Groups groups;
  struct Reading {
    Key key;
    const CuttingSignal* signal;
    const FoundCut* cut;
    CutMean mean;
  };
  std::vector<Reading> readings;
  std::map<Key, bool> air;
  double largest = 0;
  for (const FoundCut& cut : cuts) {
    const CuttingRecord& record = records[cut.record];
    for (std::size_t s = 0; s < record.signals.size() && s < cut.means.size(); ++s) {
      const CuttingSignal& signal = record.signals[s];
      const bool asked =
          std::find(sensor.of.begin(), sensor.of.end(), signal.name) != sensor.of.end();
      if (!cut.used || !asked || !std::isfinite(cut.means[s].standard_error)) continue;
      // At rest friction takes any load up to its own: what it does in the air tells nothing.
      if (stands(signal, cut) && (cut.air || !(signal.coulomb > 0))) continue;
      const Key key{signal.name, groups.of(signal, cut), cut.record};
      if (cut.air) air[key] = true;
      readings.push_back({key, &signal, &cut, cut.means[s]});
      largest = std::max(largest, std::abs(cut.means[s].value));
    }
  }
  std::map<Key, std::vector<OffsetShare>> offsets;
  // What is wrong of the friction where a reading was taken: a constant, which the air tells or the
  // file has within a part, and of an axis a part of its viscous friction, for the air may be
  // faster than the cut.
  const auto offsets_of = [&](const Reading& r) {
    Key key = r.key;
    const auto& [name, group, own] = r.key;
    for (const auto& [other, yes] : air)  // that of another record will do
      if (!air.contains(key) && std::get<0>(other) == name && std::get<1>(other) == group)
        key = other;
    const double speed = std::abs(velocity_of(*r.signal, *r.cut));
    const bool told = air.contains(key);
    if (!offsets.contains(key)) {
      std::vector<OffsetShare>& all = offsets[key];
      const auto unknown = [&](double within) {
        if (within > 0) e.rows.push_back({0, within, {}, {{e.offsets, 1}}});
        all.push_back({e.offsets++, 1});
      };
      const bool axis = r.signal->is_drive && r.signal->kind != Kind::torque;
      const double viscous = std::abs(r.signal->viscous);
      // Without air the constant is within a part of all that the file takes off, of a spindle.
      const double friction = std::abs(r.signal->coulomb) + (axis ? 0 : viscous * speed);
      const double unsure = told || !r.signal->is_drive ? 0 : kFrictionKnown * friction;
      if (told || unsure > 0) unknown(unsure);
      if (axis && viscous > 0 && !all.empty()) unknown(kFrictionKnown * viscous);
      if (!told) {
        e.friction = std::max(e.friction, kFrictionKnown * (friction + viscous * speed));
        e.trusted.push_back(name);
      }
    }
    std::vector<OffsetShare> own_shares = offsets.at(key);
    if (own_shares.size() > 1) own_shares[1].share = speed;
    return own_shares;
  };
  for (const Reading& r : readings) {
    if (r.cut->air) continue;
    const Shares shares = shares_of(r.signal->kind, geometry, *r.cut);
    const double error = std::max(r.mean.standard_error, kExact * largest);
    if (stands(*r.signal, *r.cut)) {  // friction takes any part of the load up to its own
      e.rows.push_back({r.mean.value, std::hypot(error, r.signal->coulomb), shares, {}});
      e.friction = std::max(e.friction, r.signal->coulomb);
    } else {
      e.rows.push_back({r.mean.value, error, shares, offsets_of(r)});
    }
  }
  for (const Reading& r : readings)  // air beside cuts
    if (r.cut->air && offsets.contains(r.key))
      e.rows.push_back(
          {r.mean.value, std::max(r.mean.standard_error, kExact * largest), {}, offsets_of(r)});
  std::sort(e.trusted.begin(), e.trusted.end());
  e.trusted.erase(std::unique(e.trusted.begin(), e.trusted.end()), e.trusted.end());
  return e;
}

Estimate Solution::at(std::size_t c) const {
  const auto i = static_cast<Eigen::Index>(c);
  return {value[i], std::sqrt(std::max(0.0, covariance(i, i)))};
}

Estimate Solution::ratio(std::size_t a, std::size_t b) const {
  const auto i = static_cast<Eigen::Index>(a), k = static_cast<Eigen::Index>(b);
  const double r = value[i] / value[k];
  const double variance = covariance(i, i) - 2 * r * covariance(i, k) + r * r * covariance(k, k);
  return {r, std::sqrt(std::max(0.0, variance)) / std::abs(value[k])};
}

std::optional<Solution> solve(const Equations& equations, const Wanted& wanted,
                              const Solution& held) {
  std::vector<Eigen::Index> active, fixed;
  for (std::size_t c = 0; c < kCoefficients; ++c)
    (wanted[c] ? active : fixed).push_back(static_cast<Eigen::Index>(c));
  const auto known = static_cast<Eigen::Index>(active.size());
  const auto unknowns = known + static_cast<Eigen::Index>(equations.offsets);
  const auto rows = static_cast<Eigen::Index>(equations.rows.size());
  if (rows < unknowns) return std::nullopt;
  Eigen::MatrixXd design = Eigen::MatrixXd::Zero(rows, unknowns);
  Eigen::MatrixXd others(rows, static_cast<Eigen::Index>(fixed.size()));
  Eigen::VectorXd values(rows), held_values(static_cast<Eigen::Index>(fixed.size()));
  for (Eigen::Index f = 0; f < held_values.size(); ++f)
    held_values[f] = held.value[fixed[static_cast<std::size_t>(f)]];
  for (Eigen::Index r = 0; r < rows; ++r) {
    const Row& row = equations.rows[static_cast<std::size_t>(r)];
    const auto share = [&](Eigen::Index c) { return row.shares[static_cast<std::size_t>(c)]; };
    for (Eigen::Index a = 0; a < known; ++a)
      design(r, a) = share(active[static_cast<std::size_t>(a)]) / row.error;
    for (Eigen::Index f = 0; f < held_values.size(); ++f)
      others(r, f) = share(fixed[static_cast<std::size_t>(f)]) / row.error;
    for (const OffsetShare& o : row.offsets)
      design(r, known + static_cast<Eigen::Index>(o.offset)) = o.share / row.error;
    values[r] = row.value / row.error;
  }
  values -= others * held_values;
  Eigen::VectorXd scale(unknowns);
  for (Eigen::Index c = 0; c < unknowns; ++c) {
    scale[c] = design.col(c).norm();
    if (!(scale[c] > 0)) return std::nullopt;
    design.col(c) /= scale[c];
  }
  const dense::SingularValues svd = dense::singular_values(design);
  const Eigen::VectorXd& s = svd.values;
  if (!(s[unknowns - 1] > kSingular * s[0])) return std::nullopt;
  const Eigen::MatrixXd inverse = scale.cwiseInverse().asDiagonal() * svd.v *
                                  s.cwiseInverse().asDiagonal() *
                                  svd.u.transpose();  // of the design in its own scale
  const Eigen::VectorXd found = inverse * values;
  const Eigen::VectorXd left = values - design * (scale.asDiagonal() * found);
  Solution solution = held;
  const auto freedom = static_cast<double>(rows - unknowns);
  const double chi = left.squaredNorm();
  if (freedom > 0) solution.misfit = std::sqrt(chi / freedom);
  const double grown = std::max(1.0, solution.misfit * solution.misfit);
  const Eigen::MatrixXd own = grown * (inverse * inverse.transpose()).topLeftCorner(known, known);
  const Eigen::MatrixXd by_held = -(inverse * others).topRows(known);
  Eigen::MatrixXd held_covariance(held_values.size(), held_values.size());
  for (Eigen::Index f = 0; f < held_values.size(); ++f)
    for (Eigen::Index g = 0; g < held_values.size(); ++g)
      held_covariance(f, g) =
          held.covariance(fixed[static_cast<std::size_t>(f)], fixed[static_cast<std::size_t>(g)]);
  const Eigen::MatrixXd all = own + by_held * held_covariance * by_held.transpose();
  const Eigen::MatrixXd cross = by_held * held_covariance;  // active with held
  for (Eigen::Index a = 0; a < known; ++a) {
    const Eigen::Index i = active[static_cast<std::size_t>(a)];
    solution.value[i] = found[a];
    for (Eigen::Index b = 0; b < known; ++b)
      solution.covariance(i, active[static_cast<std::size_t>(b)]) = all(a, b);
    for (Eigen::Index f = 0; f < held_values.size(); ++f) {
      const Eigen::Index k = fixed[static_cast<std::size_t>(f)];
      solution.covariance(i, k) = solution.covariance(k, i) = cross(a, f);
    }
  }
  return solution;
}

}  // namespace servosense::cutting_rows
