#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include "drive_candidate_kinds.hpp"
#include "drive_play.hpp"
#include "machine_section.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kLongerThanKnee = 4;  // travel of a presliding effect: shorter is another law
constexpr double kWiderThanKnee = 2;   // less is friction, or a spring, by another law
constexpr double kLeastRatio = 0.12;   // of the load's friction to its mass, both as shares
constexpr double kLargestRatio = 4;
constexpr unsigned kRatios = 10;                           // 1.5 apart: the least is narrow
constexpr double kLeastShare = 0.15, kLargestShare = 0.9;  // of the mass, behind the play

}  // namespace

/// The load swings on its spring at the antiresonance; its share of the mass is then linear.
Candidate coupling_candidate(std::size_t effect, const DriveSituation& s) {
  Candidate c = effect_candidate(effect, s);
  c.search.resize(2);
  c.sized = false;
  const auto setting = [effect](std::span<const double> theta, double share) {
    EffectSetting e;
    e.effect = effect;
    for (auto& p : e.parameters) p.count = 1;
    const double held = std::sqrt(1 - share);
    e.parameters[0].value[0] = theta[0] / held;
    e.parameters[1].value[0] = std::min(1.0, theta[1] / held);
    e.parameters[2].value[0] = share;
    return e;
  };
  c.columns = [s, setting](std::span<const double> theta) -> std::vector<Column> {
    Column column = s.signals->response(setting(theta, 0.5), s.model);
    if (column.empty()) return {};
    for (double& v : column) v *= 2;
    return {std::move(column)};
  };
  const bool turns = s.data->turns();
  const double most_damped = c.search[1].high / kOffBound;
  c.meaning = [setting, effect, turns, most_damped](std::span<const double> theta,
                                                    std::span<const double> coefficients) {
    Meaning m;
    const double share = coefficients[0];
    const EffectSetting e = setting(theta, std::clamp(share, 0.001, 0.95));
    for (std::size_t p = 0; p < 3; ++p)
      m.parameters.push_back(
          {kDriveEffects[effect].parameters[p].key_for(turns), {p == 2 ? share : e.scalar(p)}, {}});
    if (!(share >= 0.05 && share <= 0.85))
      m.violation = "the load would have " + printed(share, 3) + " of the mass";
    else if (!(theta[1] < most_damped))
      m.violation = "the load would not swing";
    return m;
  };
  return c;
}

/// A long bristle beside a short knee. Which knee is fitted too: alone it would have been fitted to
/// something between the two.
Candidate presliding_candidate(std::size_t effect, const DriveSituation& s) {
  Candidate c = effect_candidate(effect, s);
  const double knee = s.model.friction_knee;
  // Travels: from a few knees to what tenths of a millimetre still show.
  c.search = {{knee, 100 * knee, 12, true}, {knee / 10, 1.0001 * knee, 6, true}};
  // Of a grid most columns come again and again.
  using Columns = std::map<double, Column>;
  const auto bristles = std::make_shared<Columns>(), signs = std::make_shared<Columns>();
  const auto bristle = [s, bristles](double travel) -> const Column& {
    Column& column = (*bristles)[travel];
    if (column.empty()) column = s.signals->bristle_rows(travel);
    return column;
  };
  const auto sign = [s, signs](double travel) -> const Column& {
    Column& column = (*signs)[travel];
    if (column.empty()) column = s.signals->direction_rows(travel);
    return column;
  };
  c.columns = [bristle, sign, knee](std::span<const double> theta) -> std::vector<Column> {
    const Column& quick = sign(theta[1]);
    std::vector<Column> out = {difference(bristle(theta[0]), quick)};
    if (theta[1] < 0.99 * knee) out.push_back(difference(quick, sign(knee)));
    return out;
  };
  const EffectInfo& info = kDriveEffects[effect];
  const bool turns = s.data->turns();
  c.meaning = [info, turns, knee](std::span<const double> theta,
                                  std::span<const double> coefficients) {
    Meaning m;
    const double breakaway = coefficients[0];
    m.parameters = {{info.parameters[0].key_for(turns), {std::abs(breakaway) / theta[0]}, {}},
                    {info.parameters[1].key_for(turns), {breakaway}, {}}};
    if (!(breakaway > 0))
      m.violation =
          std::string(info.parameters[1].key_for(turns)) + " would be " + printed(breakaway, 3);
    else if (!(theta[0] > kLongerThanKnee * theta[1] && theta[0] > kOffBound * knee))
      m.violation = "its travel is that of the friction itself";
    return m;
  };
  return c;
}

std::vector<std::vector<double>> starts_of_play(const std::vector<SearchRange>& ranges) {
  const auto at = [](const SearchRange& r, unsigned k) {
    return r.low * std::pow(r.high / r.low, k / (r.points - 1.0));
  };
  std::vector<std::vector<double>> all;
  for (unsigned k = 0; k < ranges[0].points; ++k) {
    const double width = at(ranges[0], k);
    for (unsigned m = 0; m < ranges[1].points; ++m) all.push_back({width, at(ranges[1], m), 0});
    all.push_back({width, 1, 1});
  }
  if (ranges.size() > 3)
    for (auto& theta : all) theta.push_back(std::sqrt(kLeastShare * kLargestShare));
  return all;
}

/// Play: width, and how much the friction of the load slows it; its share of the mass is linear.
Candidate play_candidate(std::size_t effect, const DriveSituation& s) {
  Candidate c = effect_candidate(effect, s);
  const double knee = s.model.friction_knee;
  c.sized = false;
  c.search = {{knee, 300 * knee, 20, true}, {kLeastRatio, kLargestRatio, kRatios, true}};
  // Third: 0 for a load that is carried along after its first impact, 1 for the flanks of the
  // effect's own class, damped well enough that a record of the motor tells where the load is.
  c.search.push_back({0, 0, 1, false});
  const Column loads = loads_of(*s.signals, s.acting);
  // Where something pulls at the load, its share of the mass says by how much it accelerates.
  const bool pulled = !loads.empty();
  if (pulled) c.search.push_back({kLeastShare, kLargestShare, 3, true});
  c.starts = [ranges = c.search, found = s.play](const Column&) {
    std::vector<std::vector<double>> all = starts_of_play(ranges);
    if (found.size() == ranges.size()) all.push_back(found);
    return all;
  };
  const double own_share = s.model.load_inertia_share;
  c.columns = [s, effect, own_share, loads](std::span<const double> theta) -> std::vector<Column> {
    if (theta[2] < 0.5)
      return {response_of_play(*s.signals, s.acting,
                               {theta[0], theta[1], theta.size() > 3 ? theta[3] : 1}, loads)};
    EffectSetting e;
    e.effect = effect;
    e.parameters[0] = {{theta[0]}, 1};
    DriveModelConfig model = s.model;
    model.load_friction_share = std::min(1.0, theta[1] * own_share);
    Column column = s.signals->response(e, model);
    if (column.empty()) return {};
    for (double& x : column) x /= own_share;
    return {std::move(column)};
  };
  const char* width = kDriveEffects[effect].parameters[0].key_for(s.data->turns());
  c.meaning = [width, knee](std::span<const double> theta, std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{width, {theta[0]}, {}}};
    const double share = coefficients[0];
    if (!(share >= 0.05 && share <= 0.95))
      m.violation = "the load would have " + printed(share, 3) + " of the mass";
    else if (!(theta[0] > kOffBound * knee))
      m.violation = kAsWideAsKnee;
    else if (!(theta[1] > kOffBound * kLeastRatio && kOffBound * theta[1] < kLargestRatio &&
               share * theta[1] <= 1.1))
      m.violation = "the load would have " + printed(share * theta[1], 3) + " of the friction";
    else if (!(theta[0] > kWiderThanKnee * knee))
      m.doubt = kAsWideAsKnee;
    return m;
  };
  return c;
}

}  // namespace servosense::reconcile
