// From the means of the cuts to the coefficients: sensor by sensor, the most direct first.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "cutting_rows.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/cutting.hpp"

namespace servosense {
namespace {

using cutting_rows::Equations;
using cutting_rows::Sensor;
using cutting_rows::Solution;
using cutting_rows::Wanted;
using Kind = CuttingSignal::Kind;

constexpr double kTwoFeeds = 1.1;   // ratio from which on feeds count as two: a convention
constexpr double kWellKnown = 0.1;  // relative standard error above which more cuts are asked
constexpr double kHidden = 0.25;    // likewise, above which a ratio is none: 95 % are +-half
constexpr double kDisagree = 3;     // misfit that is said
// Off its axis a tool runs by so much in a good chuck [m], chosen; what of the coefficients is said
// when it changes by more.
constexpr double kUsualRunout_m = 5e-6, kChipShifts = 0.02, kEdgeShifts = 0.05;
constexpr std::size_t kTangential = 0, kTangentialEdge = 1, kRadial = 2, kRadialEdge = 3,
                      kAxial = 4, kAxialEdge = 5;

std::string filled(const char* format, double a, double b = 0, double c = 0) {
  char text[400];
  std::snprintf(text, sizeof text, format, a, b, c);
  return text;
}

/// Torque sensors one by one, the directional ones together; those beside the drives first.
std::vector<Sensor> sensors_of(const std::vector<CuttingRecord>& records, bool torque,
                               bool drives) {
  std::vector<Sensor> sensors;
  for (const CuttingRecord& record : records)
    for (const CuttingSignal& s : record.signals) {
      if ((s.kind == Kind::torque) != torque || s.is_drive != drives) continue;
      const auto has = [&](const Sensor& sensor) {
        return std::find(sensor.of.begin(), sensor.of.end(), s.name) != sensor.of.end();
      };
      if (std::any_of(sensors.begin(), sensors.end(), has)) continue;
      if (torque || sensors.empty())
        sensors.push_back({s.name, {s.name}});
      else {
        sensors.front().name += ", " + s.name;
        sensors.front().of.push_back(s.name);
      }
    }
  return sensors;
}

bool knows_z(const std::vector<CuttingRecord>& records) {
  for (const CuttingRecord& record : records)
    for (const CuttingSignal& s : record.signals)
      if (s.kind == Kind::z && !s.is_drive) return true;
  return false;
}

/// Whether the cuts differ in feed, or what to add.
Expected<Done> judge_plan(const std::vector<FoundCut>& cuts, const CuttingOptions& options) {
  double least = 0, most = 0;
  std::size_t used = 0, unused = 0;
  std::string why;
  for (const FoundCut& cut : cuts) {
    if (cut.air) continue;
    if (!cut.used) {
      ++unused;
      why = cut.reason;
      continue;
    }
    ++used;
    least = least > 0 ? std::min(least, cut.feed_per_tooth_m) : cut.feed_per_tooth_m;
    most = std::max(most, cut.feed_per_tooth_m);
  }
  if (used == 0)
    return data_error(unused == 0 ? "no cut was found: the records hold air only; give records in "
                                    "which the tool cuts, with air before and after"
                                  : "no cut can be used (" + why + ")");
  if (most >= kTwoFeeds * least || options.tangential_edge_N_per_m) return Done{};
  return data_error(filled("one feed, %.3g mm a tooth: the edge coefficient cannot be told from "
                           "that of the chip; add a cut at half the feed, %.3g mm, or write [tool] "
                           "tangential_edge_N_per_m where it is known",
                           1e3 * most, 1e3 * most / 2) +
                    (unused > 0 ? " (" + std::to_string(unused) + " not used: " + why + ")" : ""));
}

class Identification {
 public:
  Identification(const CutGeometry& geometry, const std::vector<CuttingRecord>& records,
                 const CuttingOptions& options, CuttingIdentification& found)
      : geometry_(geometry), records_(records), options_(options), found_(found) {}

  Expected<Done> run() {
    for (const Sensor& s : sensors_of(records_, true, false)) tangential(s);
    for (const Sensor& s : sensors_of(records_, false, false)) forces(s);
    for (const Sensor& s : sensors_of(records_, true, true)) tangential(s);
    if (!main_)
      return data_error(
          "no sensor of the records tells the torque of the cuts; record the torque, "
          "current, power or load of the spindle, or the forces of a dynamometer");
    found_.tangential_N_per_m2 = main_->at(kTangential);
    found_.tangential_edge_N_per_m = main_->at(kTangentialEdge);
    found_.misfit = main_->misfit;
    if (!(found_.tangential_N_per_m2.value > 0))
      return data_error(
          "the torque does not grow with the feed per tooth; check that feeds, depth "
          "and width are those of the records");
    if (!direct_) {
      for (const Sensor& s : sensors_of(records_, false, true)) radial(s);
    } else if (const Solution& d = *direct_; d.value[kTangential] > 0) {
      found_.radial_ratio = d.ratio(kRadial, kTangential);
      found_.radial_edge_N_per_m = d.at(kRadialEdge);
      if (knows_z(records_)) {
        found_.axial_N_per_m2 = d.at(kAxial);
        found_.axial_edge_N_per_m = d.at(kAxialEdge);
      }
    }
    judge();
    return Done{};
  }

 private:
  void take(const Sensor& sensor, const Solution& solution, const Equations& e) {
    found_.sensors.push_back({sensor.name, solution.at(kTangential), solution.at(kTangentialEdge)});
    if (!main_) main_ = solution;
    for (const std::string& name : e.trusted)
      found_.remarks.push_back(
          name +
          ": no air at the speed or direction of a cut; the friction of the machine file is "
          "believed within 10 %, where it has any; record the same motion in the air");
    if (solution.misfit > kDisagree)
      found_.remarks.push_back(
          sensor.name + filled(": the cuts lie %.1f standard errors off the law, so the errors of "
                               "the coefficients are widened; look for wear, run-out or another "
                               "depth or width among them",
                               solution.misfit));
  }
  void tangential(const Sensor& sensor) {
    const Equations e = cutting_rows::equations(sensor, geometry_, records_, found_.cuts);
    Wanted wanted{true, true};
    auto solution = cutting_rows::solve(e, wanted);
    if (!solution && options_.tangential_edge_N_per_m) {
      Solution held;
      held.value[kTangentialEdge] = *options_.tangential_edge_N_per_m;
      wanted[kTangentialEdge] = false;
      solution = cutting_rows::solve(e, wanted, held);
      found_.edge_held = found_.edge_held || (solution && !main_);
    }
    if (solution) take(sensor, *solution, e);
  }
  /// Of a dynamometer, which tells all of them.
  void forces(const Sensor& sensor) {
    const Equations e = cutting_rows::equations(sensor, geometry_, records_, found_.cuts);
    const bool z = knows_z(records_);
    direct_ = cutting_rows::solve(e, {true, true, true, true, z, z});
    if (direct_)
      take(sensor, *direct_, e);
    else
      found_.remarks.push_back(sensor.name +
                               ": these forces alone do not tell the coefficients; "
                               "record x and y at two feeds or more");
  }
  /// From the axes, which friction blurs.
  void radial(const Sensor& sensor) {
    const Equations e = cutting_rows::equations(sensor, geometry_, records_, found_.cuts);
    const auto solution = cutting_rows::solve(e, {false, false, true, true}, *main_);
    const std::string advice =
        "; cut along the axes that have little friction, and record the "
        "same feed and direction in the air";
    if (!solution) {
      found_.remarks.push_back(
          "radial coefficients: no axis moves in the cuts at two feeds, or "
          "their friction is not known" +
          advice);
      return;
    }
    const Estimate ratio = solution->ratio(kRadial, kTangential);
    if (ratio.standard_error > kHidden * std::abs(ratio.value)) {
      found_.remarks.push_back(
          "radial coefficients: friction of the axes hides them" +
          filled(" (radial ratio %.2g +- %.2g)", ratio.value, ratio.standard_error) +
          (e.friction > 0 ? filled(", unsure by %.3g N", e.friction) : std::string()) + advice);
      return;
    }
    found_.radial_ratio = ratio;
    found_.radial_edge_N_per_m = solution->at(kRadialEdge);
    if (solution->misfit > kDisagree)
      found_.remarks.push_back(
          filled("radial coefficients: the forces of the axes lie %.1f "
                 "standard errors off the law; the errors are widened",
                 solution->misfit));
  }
  void judge() {
    const auto poor = [&](const char* name, const Estimate& e) {
      if (e.standard_error > kWellKnown * std::abs(e.value))
        found_.remarks.push_back(
            std::string(name) +
            filled(" is known within %.0f %% only; cut longer, and at feeds that differ by a "
                   "factor of four",
                   100 * e.standard_error / std::abs(e.value)));
    };
    poor("the tangential coefficient", found_.tangential_N_per_m2);
    if (!found_.edge_held) poor("the tangential edge coefficient", found_.tangential_edge_N_per_m);
    for (std::size_t s = 1; s < found_.sensors.size(); ++s) {
      const SensorCoefficients &a = found_.sensors[0], &b = found_.sensors[s];
      found_.remarks.push_back(
          b.sensor + " against " + a.sensor +
          filled(": tangential coefficient %+.1f %%, edge %+.1f %%",
                 100 * (b.tangential_N_per_m2.value / a.tangential_N_per_m2.value - 1),
                 100 * (b.tangential_edge_N_per_m.value / a.tangential_edge_N_per_m.value - 1)));
    }
  }

  const CutGeometry& geometry_;
  const std::vector<CuttingRecord>& records_;
  const CuttingOptions& options_;
  CuttingIdentification& found_;
  std::optional<Solution> main_, direct_;
};

/// Where one axis alone has told the feed.
void judge_feed(const std::vector<CuttingRecord>& records, CuttingIdentification& found) {
  for (std::size_t r = 0; r < records.size(); ++r) {
    const bool x = !records[r].velocity_m_s[0].empty(), y = !records[r].velocity_m_s[1].empty();
    if (!records[r].feed_per_tooth_m.empty() || x == y) continue;
    const std::size_t axis = x ? 0 : 1;
    if (std::ranges::none_of(found.cuts, [&](const FoundCut& cut) {
          return cut.record == r && cut.used && !cut.air &&
                 std::abs(cut.velocity_m_s[axis]) > cutting_rows::kStill_m_s;
        }))
      continue;
    found.remarks.push_back(records[r].name + ": " + (x ? "x" : "y") +
                            " alone tells the feed; record " + (x ? "y" : "x") +
                            " too where it moves");
  }
}

/// What run-out that nobody has measured may do to the coefficients.
void judge_runout(const CutGeometry& geometry, const std::vector<CuttingRecord>& records,
                  const CuttingOptions& options, CuttingIdentification& found) {
  if (geometry.runout_known) return;
  MillingTool tool;
  tool.teeth = geometry.teeth;
  add_offset(tool, kUsualRunout_m, 0);
  CutGeometry thrown = geometry;
  thrown.throw_m = tool.throw_m;
  CuttingIdentification other;
  other.cuts = found.cuts;
  if (!Identification(thrown, records, options, other).run()) return;
  const auto more = [](const Estimate& a, const Estimate& b) { return a.value / b.value - 1; };
  const double chip = more(other.tangential_N_per_m2, found.tangential_N_per_m2),
               edge = more(other.tangential_edge_N_per_m, found.tangential_edge_N_per_m);
  if (!(std::abs(chip) > kChipShifts || std::abs(edge) > kEdgeShifts)) return;
  found.remarks.push_back(
      filled("[tool] has no run-out: with %.3g um of it teeth miss a part of their chip, and the "
             "tangential coefficient would be %+.0f %%, the edge %+.0f %%, which no interval "
             "knows; indicate the teeth and write runout_m or throw_m",
             1e6 * kUsualRunout_m, 100 * chip, 100 * edge));
}

}  // namespace

Expected<CuttingIdentification> identify_cutting(const CutGeometry& geometry,
                                                 const std::vector<CuttingRecord>& records,
                                                 const CuttingOptions& options) {
  CuttingIdentification found;
  for (std::size_t r = 0; r < records.size(); ++r) {
    auto cuts = find_cuts(records[r], geometry);
    if (!cuts) return cuts.error();
    for (FoundCut& cut : *cuts) {
      cut.record = r;
      found.cuts.push_back(std::move(cut));
    }
  }
  if (auto good = judge_plan(found.cuts, options); !good) return good.error();
  if (auto done = Identification(geometry, records, options, found).run(); !done)
    return done.error();
  judge_feed(records, found);
  judge_runout(geometry, records, options, found);
  return found;
}

}  // namespace servosense
