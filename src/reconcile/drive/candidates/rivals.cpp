// What drives are known to have and the catalogue lacks. Such a rival is ranked like any effect and
// never named: where it fits far better than all that may be named, the cause is none of them.
#include <algorithm>
#include <cmath>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "reconcile/drive/candidates/kinds.hpp"

namespace servosense::reconcile {
namespace {

using Columns = std::function<std::vector<Column>(std::span<const double>)>;

Candidate rival(std::string name, std::string where, const std::string& what,
                std::vector<SearchRange> search, Columns columns) {
  Candidate c;
  c.name = std::move(name);
  c.rival = what;
  c.where = std::move(where);
  c.refuted = what + " fits best, and is not in the catalogue";
  c.search = std::move(search);
  c.columns = std::move(columns);
  c.meaning = [](std::span<const double>, std::span<const double>) { return Meaning{}; };
  return c;
}

/// Chains of cables, bellows, stops: a polynomial of the third order.
Candidate hardening_spring(const DriveSituation& s) {
  const double middle = 0.5 * (s.low + s.high);
  const double half = std::max(1e-12, 0.5 * (s.high - s.low));
  return rival("hardening-spring", "position", "a spring that is no line along the stroke", {},
               [signals = s.signals, middle, half,
                constant_known = s.constant_known](std::span<const double>) {
                 std::vector<Column> powers;
                 if (!constant_known) powers.emplace_back(signals->rows(), 1.0);
                 Column power(signals->rows(), 1.0);
                 for (int k = 0; k < 3; ++k) {
                   for (std::size_t i = 0; i < power.size(); ++i)
                     power[i] *= (signals->position_rows[i] - middle) / half;
                   powers.push_back(power);
                 }
                 return powers;
               });
}

/// Magnets lose field as the motor warms up: all that it is to exert takes more current, also what
/// accelerates, which friction knows nothing of.
Candidate force_constant_drift(const DriveSituation& s, const Column& direction) {
  // Of the model, not as measured: noise would explain itself.
  Column force(s.signals->rows(), 0);
  double square = 0;
  for (std::size_t i = 0; i < force.size(); ++i) {
    force[i] = s.model.inertia * s.signals->acceleration_rows[i] +
               s.model.viscous * s.signals->velocity_rows[i] + s.model.coulomb * direction[i];
    square += force[i] * force[i];
  }
  if (!(square > 0)) square = 1;
  const double mean_square = square / static_cast<double>(force.size());
  const double period = s.signals->row_period_s();
  return rival("force-constant-drift", "time",
               "a motor whose force per current changes as it warms up",
               {{0.08 * s.duration_s, 2 * s.duration_s, 10}},
               [force, mean_square, period](std::span<const double> theta) {
                 Column column = force;
                 double heat = 0;
                 for (double& f : column) {
                   heat += period / theta[0] * (f * f / mean_square - heat);
                   f *= heat;
                 }
                 return std::vector<Column>{std::move(column)};
               });
}

/// A film of oil, or seals, at one speed; to nothing at rest, where Stribeck's law is largest.
Candidate friction_at_a_speed(const DriveSituation& s, const Column& direction) {
  return rival("friction-at-a-speed", "velocity", "a dip or a hump of friction at one speed",
               {{0.08 * s.top_speed, 0.8 * s.top_speed, 10}, {0.15, 0.4, 3}},
               [signals = s.signals, direction](std::span<const double> theta) {
                 if (!(theta[1] < 0.5)) return std::vector<Column>{};
                 Column column = direction;
                 for (std::size_t i = 0; i < column.size(); ++i) {
                   const double off =
                       (std::abs(signals->velocity_rows[i]) / theta[0] - 1) / theta[1];
                   column[i] *= std::exp(-0.5 * off * off);
                 }
                 return std::vector<Column>{std::move(column)};
               });
}

}  // namespace

std::vector<Candidate> drive_rivals(const DriveSituation& s) {
  const Column direction = s.signals->direction_rows(s.model.friction_knee);
  return {hardening_spring(s), force_constant_drift(s, direction),
          friction_at_a_speed(s, direction)};
}

}  // namespace servosense::reconcile
