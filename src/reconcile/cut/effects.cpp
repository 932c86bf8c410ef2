#include "reconcile/cut/effects.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "reconcile/numerics/least_squares.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {

using enum Unknown::Kind;

namespace {

std::string no_objection(const FittedEffect& /*effect*/) { return {}; }

std::vector<NamedValue> no_parameters(const FittedEffect& /*effect*/, bool /*errors*/) {
  return {};
}

/// The only unknown, under the only key.
std::vector<NamedValue> one_parameter(const FittedEffect& e, bool errors) {
  return {{e.family.info->parameters[0].key, {errors ? e.error(0) : e.value(0)}}};
}

/// Logarithms of values, under these keys.
template <typename Keys>
std::vector<NamedValue> of_logarithms(const FittedEffect& e, bool errors, const Keys& key) {
  std::vector<NamedValue> out;
  for (std::size_t k = 0; k < e.family.unknowns.size(); ++k) {
    const double value = std::exp(e.value(k));
    out.push_back({key(k), {errors ? e.error(k) * value : value}});
  }
  return out;
}

// ---- Edge force

void edge_families(const CutFitter& cut, const CutFit& /*base*/, std::vector<Family>& all) {
  if (!cut.given().edges) all.push_back({.info = &EdgeForceEffect::info, .edges = true});
}

std::string edge_objection(const FittedEffect& e) {
  const double kte = e.fit.state.coefficients[2], kre = e.fit.state.coefficients[3];
  const double sure = e.criteria.sure_standard_errors;
  if (!(kte < -sure * e.fit.coefficient_errors(2) || kre < -sure * e.fit.coefficient_errors(3)))
    return {};
  // Small beside the other is no contradiction: one of them may be absent.
  if (kte < -0.15 * std::abs(kre) || kre < -0.15 * std::abs(kte))
    return "shape fits, physics does not: an edge force that pulls";
  return {};
}

std::vector<NamedValue> edge_parameters(const FittedEffect& e, bool errors) {
  std::vector<NamedValue> out;
  for (std::size_t k = 0; k < 2; ++k)
    out.push_back({e.family.info->parameters[k].key,
                   {errors ? e.fit.coefficient_errors(static_cast<Eigen::Index>(2 + k))
                           : std::max(0.0, e.fit.state.coefficients[2 + k])}});
  return out;
}

// ---- Size effect

void size_families(const CutFitter& cut, const CutFit& /*base*/, std::vector<Family>& all) {
  if (!cut.has(exponent))
    all.push_back({&SizeEffect::info, {{exponent, 0, -0.5, 0.9, 1e-3}}, {{0.05}, {0.25}}});
}

std::string size_objection(const FittedEffect& e) {
  return e.value(0) > 0 ? ""
                        : "shape fits, physics does not: force that grows faster than the chip";
}

// ---- Run-out

void runout_families(const CutFitter& cut, const CutFit& /*base*/, std::vector<Family>& all) {
  const int teeth = cut.given().tool.teeth;
  if (teeth < 2 || cut.has(throw_x)) return;
  Family f{&RunoutEffect::info, {{throw_x, 0, -3, 3, 1e-3}}, {}};
  if (teeth > 2) f.unknowns.push_back({throw_y, 0, -3, 3, 1e-3});
  // Of two teeth it is one short tooth by half: from the same starts, so that both end alike.
  const std::array<double, 3> sizes =
      teeth == 2 ? std::array{0.05, 0.2, 0.5} : std::array{0.1, 0.3, 0.8};
  for (const double size : sizes)
    for (int k = 0; k < 8; ++k) {
      const double at = kTwoPi * k / 8;
      if (teeth > 2)
        f.starts.push_back({size * std::cos(at), size * std::sin(at)});
      else if (k % 4 == 0)
        f.starts.push_back({size * std::cos(at)});
    }
  all.push_back(std::move(f));
}

std::string runout_objection(const FittedEffect& e) {
  return std::hypot(e.value(0), e.value(e.family.unknowns.size() - 1)) > 2.9
             ? "shape fits, physics does not: a throw of several feeds"
             : "";
}

std::vector<NamedValue> runout_parameters(const FittedEffect& e, bool errors) {
  const bool plane = e.family.unknowns.size() > 1;
  const double x = e.value(0), y = plane ? e.value(1) : 0, size = std::hypot(x, y);
  if (!errors) return {{"throw_m", {size * e.feed_per_tooth_m}}, {"angle_rad", {std::atan2(y, x)}}};
  const double error =
      plane ? root(0.5 * (e.error(0) * e.error(0) + e.error(1) * e.error(1))) : e.error(0);
  return {{"throw_m", {error * e.feed_per_tooth_m}},
          {"angle_rad", {size > 0 ? error / size : kPi}}};
}

// ---- Missing tooth

void tooth_families(const CutFitter& cut, const CutFit& /*base*/, std::vector<Family>& all) {
  const auto teeth = static_cast<std::size_t>(cut.given().tool.teeth);
  for (std::size_t j = 0; j < teeth && teeth > 1; ++j) {
    all.push_back({&MissingToothEffect::info,
                   {{broken, j, 0, 1, 1e-3}},
                   {{0.05}, {0.3}, {0.7}, {1}},
                   false,
                   j,
                   "missing-tooth"});
    all.push_back({&MissingToothEffect::info,
                   {{shorter, j, -2, 2.5 * static_cast<double>(teeth), 1e-3}},
                   {{0.1}, {0.4}, {1.0}},
                   false,
                   j,
                   "missing-tooth"});
  }
}

std::string tooth_objection(const FittedEffect& e) {
  if (e.value(0) > 0) return {};
  return e.unknown(0).kind == broken ? "nothing is broken"
                                     : "shape fits, physics does not: a tooth that has grown";
}

std::vector<NamedValue> tooth_parameters(const FittedEffect& e, bool errors) {
  const double value = errors ? e.error(0) : e.value(0);
  std::vector<NamedValue> out = {
      {"tooth", {errors ? 0 : static_cast<double>(e.family.tooth + 1)}},
      {"fraction", {errors || e.unknown(0).kind == broken ? value : std::min(1.0, value)}}};
  if (e.unknown(0).kind == shorter) out.push_back({"shorter_m", {value * e.feed_per_tooth_m}});
  return out;
}

// ---- Pitch error

void pitch_families(const CutFitter& cut, const CutFit& /*base*/, std::vector<Family>& all) {
  const auto teeth = static_cast<std::size_t>(cut.given().tool.teeth);
  if (teeth < 2) return;
  Family f{&PitchErrorEffect::info, {}, {{}}};
  const double most = cut.criteria().most_pitch_error * kTwoPi / static_cast<double>(teeth);
  for (std::size_t j = 1; j < teeth; ++j) {
    f.unknowns.push_back({pitch, j, -most, most, 1e-3});
    f.starts[0].push_back(0);
  }
  for (std::size_t j = 1; j < teeth; ++j)
    for (const double off : {-0.05, 0.05}) {
      f.starts.push_back(f.starts[0]);
      f.starts.back()[j - 1] = off;
    }
  all.push_back(std::move(f));
}

std::string pitch_objection(const FittedEffect& e) {
  for (std::size_t k = 0; k < e.family.unknowns.size(); ++k)
    if (std::abs(e.value(k)) > 0.99 * e.unknown(k).high)
      return "shape fits, physics does not: a tooth next to another one";
  return {};
}

std::vector<NamedValue> pitch_parameters(const FittedEffect& e, bool errors) {
  NamedValue v{"angle_rad", {0}};
  for (std::size_t k = 0; k < e.family.unknowns.size(); ++k)
    v.values.push_back(errors ? e.error(k) : e.value(k));
  return {v};
}

// ---- Helix lag

void helix_families(const CutFitter& cut, const CutFit& /*base*/, std::vector<Family>& all) {
  Family f{&HelixLagEffect::info, {{helix, 0, -5, 70, 1e-2}}, {}};
  for (const double part : {0.6, 0.8, 1.25, 1.6})
    f.starts.push_back({part * cut.given().tool.helix_deg});
  for (const double deg : {5.0, 20.0, 35.0, 50.0}) f.starts.push_back({deg});
  all.push_back(std::move(f));
}

std::string helix_objection(const FittedEffect& e) {
  return e.value(0) >= 69.9 || e.value(0) <= -4.9 ? "shape fits, physics does not: no such helix"
                                                  : "";
}

// ---- Regeneration

void regeneration_families(const CutFitter& cut, const CutFit& /*base*/, std::vector<Family>& all) {
  if (cut.forced_only()) all.push_back({.info = &RegenerationEffect::info, .regeneration = true});
}

// ---- Process damping

void damping_families(const CutFitter& cut, const CutFit& /*base*/, std::vector<Family>& all) {
  // The speed of the tool is known where its modes are.
  const CutState& given = cut.given();
  if ((given.structure.x.empty() && given.structure.y.empty()) ||
      given.tool.force.process_damping_N_per_m != 0)
    return;
  all.push_back(
      {&ProcessDampingEffect::info, {{damping, 0, -1, 10, 1e-3}}, {{0.05}, {0.3}, {1.5}}});
}

std::string damping_objection(const FittedEffect& e) {
  return e.value(0) > 0 ? "" : "shape fits, physics does not: a process that drives vibration";
}

std::vector<NamedValue> damping_parameters(const FittedEffect& e, bool errors) {
  const double value = errors ? e.error(0) : e.value(0);
  return {{e.family.info->parameters[0].key, {value * 1e-3 * e.tangential_N_per_m2}}};
}

// ---- Resonance of the sensor

void sensor_families(const CutFitter& cut, const CutFit& base, std::vector<Family>& all) {
  cut.add_sensor_resonance(base, all);
}

std::string sensor_objection(const FittedEffect& e) {
  const double most = std::log(e.criteria.most_damping);
  const auto known = [&](std::size_t k) { return e.error(k) < e.criteria.known_logarithm; };
  // In a direction that hardly rings the damping may be anything, and its error says so.
  const auto damped = [&](std::size_t k) {
    return e.value(k) > most + (known(k) ? 0 : 2 * e.error(k));
  };
  // One that is no faster than the rotation lets no tooth through.
  for (const std::size_t k : {std::size_t{0}, std::size_t{2}})
    if (e.value(k) < e.unknown(k).low + 0.01)
      return "shape fits, physics does not: a sensor slower than the rotation";
  // One beyond the samples sharpens edges: it stands in for how samples are taken.
  const auto beyond = [&](std::size_t k) {
    return e.value(k) > e.unknown(k).high - std::log(kBeyondBand);
  };
  if ((beyond(0) && (beyond(2) || known(1))) || (beyond(2) && known(3)))
    return "shape fits, physics does not: a sensor faster than the samples";
  if (damped(1) || damped(3) || std::min(e.value(1), e.value(3)) > most)
    return "shape fits, physics does not: a resonance with a damping of 0.3 and more";
  return {};
}

std::vector<NamedValue> sensor_parameters(const FittedEffect& e, bool errors) {
  constexpr std::array kKeys = {"natural_frequency_hz", "damping_ratio", "natural_frequency_y_hz",
                                "damping_ratio_y"};
  return of_logarithms(e, errors, [&](std::size_t k) { return kKeys[k]; });
}

// ---- Mode of the tool

void mode_families(const CutFitter& cut, const CutFit& base, std::vector<Family>& all) {
  cut.add_modes(base, all);
}

std::string mode_objection(const FittedEffect& e) {
  if (!(e.error(0) > 0)) return "nothing vibrates";
  if (e.value(0) > e.unknown(0).high - std::log(kBeyondBand))
    return "shape fits, physics does not: a mode faster than the samples";
  if (e.value(1) > std::log(e.criteria.most_damping))
    return "shape fits, physics does not: a resonance with a damping of 0.3 and more";
  return {};
}

std::vector<NamedValue> mode_parameters(const FittedEffect& e, bool errors) {
  return of_logarithms(e, errors, [&](std::size_t k) { return e.family.info->parameters[k].key; });
}

constexpr CutEffect kEffects[] = {
    {&EdgeForceEffect::info, edge_families, edge_objection, edge_parameters},
    {&SizeEffect::info, size_families, size_objection, one_parameter},
    {&RunoutEffect::info, runout_families, runout_objection, runout_parameters},
    {&MissingToothEffect::info, tooth_families, tooth_objection, tooth_parameters},
    {&PitchErrorEffect::info, pitch_families, pitch_objection, pitch_parameters},
    {&HelixLagEffect::info, helix_families, helix_objection, one_parameter},
    {&RegenerationEffect::info, regeneration_families, no_objection, no_parameters},
    {&ProcessDampingEffect::info, damping_families, damping_objection, damping_parameters},
    {&SensorResonanceEffect::info, sensor_families, sensor_objection, sensor_parameters},
    {&ExtraModeEffect::info, mode_families, mode_objection, mode_parameters}};

}  // namespace

FoundEffect found_effect(const CuttingEffectInfo& info) {
  FoundEffect e;
  e.name = info.name;
  e.scope = info.scope;
  e.where = info.where;
  return e;
}

std::span<const CutEffect> cut_effects() { return kEffects; }

const CutEffect& cut_effect(const CuttingEffectInfo* info) {
  return *std::ranges::find(kEffects, info, &CutEffect::info);
}

}  // namespace servosense::reconcile
