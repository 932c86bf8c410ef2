// What the torque law predicts of recorded cuts that did not teach it, beside the straight lines
// that a user would draw: a circular saw in a round bar, whose geometry is known; a mill that cuts
// wax; a turn-mill of which neither program nor feeds are published. The figures are those of
// docs/torque-prediction.md.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/torque_equation_fit.hpp"
#include "servosense/process/torque/torque_equation.hpp"

namespace fs = std::filesystem;
using namespace servosense;

namespace {

using Values = std::vector<double>;

/// Columns of a published table by their names, a row each.
std::vector<Values> rows_of(const fs::path& path, const std::vector<std::string>& names) {
  std::ifstream in(path);
  std::string line;
  std::vector<std::size_t> at;
  std::vector<Values> rows;
  while (std::getline(in, line)) {
    std::vector<std::string> fields;
    std::stringstream parts(line);
    for (std::string f; std::getline(parts, f, ',');) fields.push_back(f);
    if (at.empty()) {
      for (const std::string& name : names) {
        const auto found = std::find(fields.begin(), fields.end(), name);
        CHECK(found != fields.end());
        if (found == fields.end()) return {};
        at.push_back(static_cast<std::size_t>(found - fields.begin()));
      }
      continue;
    }
    Values row;
    for (const std::size_t i : at)
      row.push_back(i < fields.size() ? std::strtod(fields[i].c_str(), nullptr) : std::nan(""));
    rows.push_back(row);
  }
  return rows;
}

double mean(const Values& of) {
  double sum = 0;
  for (const double v : of) sum += v;
  return sum / static_cast<double>(of.size());
}
double standard_error(const Values& of) {
  const double about = mean(of);
  double sum = 0;
  for (const double v : of) sum += (v - about) * (v - about);
  const auto n = static_cast<double>(of.size());
  return std::sqrt(sum / (n * (n - 1)));
}
double median(Values of) {
  std::sort(of.begin(), of.end());
  return of[of.size() / 2];
}
double rms(const Values& of) {
  double sum = 0;
  for (const double v : of) sum += v * v;
  return std::sqrt(sum / static_cast<double>(of.size()));
}

// ------------------------------------------------------------------------------------------ saw

constexpr double kBlade_m = 0.45, kBar_m = 0.146, kTeeth = 60;  // radii

struct SawPoint {
  double into_m = 0;     ///< how far the blade has come into the bar
  double power_W = 0;    ///< active power, less that of the air before the cut
  double width_m = 0;    ///< V over the kerf, which is not published and the same in all cuts
  double contact_m = 0;  ///< S over the kerf
};
struct SawCut {
  double speed_rad_s = 0, feed_m_s = 0, feed_per_tooth_m = 0;
  double entry_m = 0;  ///< where the power rises
  std::vector<SawPoint> points;
};

/// A cut as its file has it; `points` still without geometry.
SawCut saw_cut(const fs::path& path, double cutting_m_min) {
  SawCut cut;
  cut.speed_rad_s = cutting_m_min / 60 / kBlade_m;
  Values speeds, air;
  for (const Values& row : rows_of(path, {"head_z_hmi", "head_vel", "active_power_W"})) {
    if (!(row[0] < 0) || !(row[1] < -0.5)) continue;
    speeds.push_back(-row[1] * 1e-3);
    if (row[0] > -20 && row[0] < -8) air.push_back(row[2]);
    cut.points.push_back({-row[0] * 1e-3, row[2]});
  }
  cut.feed_m_s = median(speeds);
  cut.feed_per_tooth_m = cut.feed_m_s / (kTeeth * cut.speed_rad_s / kTwoPi);
  const double level = median(air);
  double highest = 0;
  for (SawPoint& p : cut.points) highest = std::max(highest, p.power_W -= level);
  for (const SawPoint& p : cut.points)
    if (p.into_m > 0.02 && p.power_W > 0.1 * highest) {
      cut.entry_m = p.into_m;
      break;
    }
  return cut;
}

/// The arc of the blade within the bar, on a way through the bar's centre; without the first and
/// last 10 mm.
std::vector<SawPoint> within_bar(const SawCut& cut, double entry_m) {
  std::vector<SawPoint> points;
  for (SawPoint p : cut.points) {
    p.into_m -= entry_m;
    if (p.into_m < 0.01 || p.into_m > 2 * kBar_m - 0.01) continue;
    const double apart = kBlade_m + kBar_m - p.into_m;
    const double half =
        std::acos((kBlade_m * kBlade_m + apart * apart - kBar_m * kBar_m) / (2 * kBlade_m * apart));
    p.width_m = 2 * kBlade_m * std::sin(half);
    p.contact_m = 2 * kBlade_m * half;
    points.push_back(p);
  }
  return points;
}

/// Two constants by least squares.
Eigen::Vector2d fit(const std::vector<Eigen::Vector2d>& rows, const Values& values) {
  Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    square += rows[i] * rows[i].transpose();
    right += rows[i] * values[i];
  }
  return square.ldlt().solve(right);
}

/// Every pair of stable cuts with other feeds teaches; the other seven are predicted.
void saw() {
  const std::string folder = check::outside_data("nolicence/saw-chatter-servo");
  if (folder.empty()) return;
  const std::vector<std::pair<const char*, double>> published = {
      {"1", 100}, {"2", 110}, {"4", 110},  {"5", 120}, {"6", 120},
      {"7", 120}, {"9", 115}, {"10", 115}, {"11", 115}};  // m/min
  std::vector<SawCut> cuts;
  for (const auto& [name, speed] : published)
    cuts.push_back(saw_cut(folder + "/cut_" + name + ".csv", speed));
  // Errors of a point of the cut and of a cut's mean, as shares of the cut's mean power.
  Values law_points, law_means, removal_points, removal_means, feed_points, feed_means;
  std::size_t pairs = 0, refused = 0;
  for (std::size_t a = 0; a < cuts.size(); ++a)
    for (std::size_t b = a + 1; b < cuts.size(); ++b) {
      const auto alike = [&](double SawCut::*of) {
        return std::abs(cuts[a].*of / cuts[b].*of - 1) < 0.05;
      };
      if (alike(&SawCut::feed_per_tooth_m) || alike(&SawCut::feed_m_s)) continue;
      ++pairs;
      const double entry = (cuts[a].entry_m + cuts[b].entry_m) / 2;
      std::vector<Eigen::Vector2d> of_law, of_removal, of_feed;
      Values torques, powers;
      std::vector<TorqueCut> taught;
      for (const std::size_t i : {a, b})
        for (const SawPoint& p : within_bar(cuts[i], entry)) {
          const SawCut& c = cuts[i];
          taught.push_back({p.width_m, p.contact_m, c.feed_per_tooth_m, p.power_W / c.speed_rad_s});
          torques.push_back(taught.back().torque_Nm);
          powers.push_back(p.power_W);
          of_law.emplace_back(p.width_m * c.feed_per_tooth_m, p.contact_m);
          of_removal.emplace_back(p.width_m * c.feed_m_s, 1);
          of_feed.emplace_back(c.feed_m_s, 1);
        }
      // The blade is so much larger than the bar that contact is as long as the cut is wide.
      const auto equation = fit_torque_equation(taught);
      refused += !equation && equation.error().sentence.find("L/a") != std::string::npos ? 1U : 0U;
      const Eigen::Vector2d k = fit(of_law, torques);
      const process::TorqueEquation law{k[0], 0, k[1]};
      const Eigen::Vector2d removal = fit(of_removal, powers), feed = fit(of_feed, powers);
      for (std::size_t i = 0; i < cuts.size(); ++i) {
        if (i == a || i == b) continue;
        const SawCut& c = cuts[i];
        Values power, by_law, by_removal, by_feed;
        for (const SawPoint& p : within_bar(c, entry)) {
          power.push_back(p.power_W);
          by_law.push_back(law.torque_Nm(p.width_m, p.contact_m, c.feed_per_tooth_m) *
                               c.speed_rad_s -
                           p.power_W);
          by_removal.push_back(removal[0] * p.width_m * c.feed_m_s + removal[1] - p.power_W);
          by_feed.push_back(feed[0] * c.feed_m_s + feed[1] - p.power_W);
        }
        const double whole = mean(power);
        law_points.push_back(rms(by_law) / whole), law_means.push_back(mean(by_law) / whole);
        removal_points.push_back(rms(by_removal) / whole);
        removal_means.push_back(mean(by_removal) / whole);
        feed_points.push_back(rms(by_feed) / whole), feed_means.push_back(mean(by_feed) / whole);
      }
    }
  check::figure("saw: pairs that teach", static_cast<double>(pairs));
  check::figure("saw: of them refused by torque-equation", static_cast<double>(refused));
  const auto share = [](const char* what, const Values& points, const Values& means) {
    std::printf("  saw: %-44s %6.2f %% of a point, %5.2f %% of a cut\n", what, 100 * rms(points),
                100 * rms(means));
  };
  share("V f and S", law_points, law_means);
  share("line over the volume removed a second", removal_points, removal_means);
  share("line over the feed", feed_points, feed_means);
  CHECK(pairs > 20 && refused == pairs);
  CHECK_BETWEEN(rms(law_points), 0.05, 0.06);
  CHECK_BETWEEN(rms(law_means), 0.035, 0.04);
  CHECK(rms(law_points) < rms(removal_points) && rms(removal_points) < rms(feed_points));
  CHECK(rms(law_means) < rms(removal_means) && rms(law_means) < rms(feed_means));
}

// ----------------------------------------------------------------------------------------- wax

/// All parts have the same geometry and speed, so that any law is a line over the feed. The part
/// with the highest feed teaches what the cut adds to the air.
void wax() {
  const std::string folder = check::outside_data("umich-cnc-mill");
  if (folder.empty()) return;
  struct Part {
    double number = 0, feed_mm_s = 0, cut_W = 0, air_W = 0, error_W = 0;
  };
  std::vector<Part> parts;
  for (const Values& of : rows_of(folder + "/runs.csv", {"No", "feedrate_mm_s"})) {
    char name[32];
    std::snprintf(name, sizeof name, "experiment_%02d.csv", static_cast<int>(of[0]));
    Values cut, air;
    for (const Values& row : rows_of(fs::path(folder) / name,
                                     {"S1_ActualVelocity", "Z1_ActualPosition", "X1_ActualVelocity",
                                      "Y1_ActualVelocity", "S1_OutputPower"})) {
      if (row[0] < 53 || row[0] > 53.8) continue;  // 3200 rpm
      // Layers are at 27.5, 28.5 and 29.5 mm, 0.2 mm higher with the second tool.
      const double feed = std::hypot(row[2], row[3]);
      if (row[1] > 32)
        air.push_back(row[4] * 1e3);
      else if (row[1] < 29.8 && std::abs(feed - of[1]) < 0.25 * of[1])
        cut.push_back(row[4] * 1e3);
    }
    if (air.size() < 30) continue;
    parts.push_back(
        {of[0], of[1], mean(cut), mean(air), std::hypot(standard_error(cut), standard_error(air))});
  }
  const auto teacher =
      std::find_if(parts.begin(), parts.end(), [](const Part& p) { return p.number == 8; });
  CHECK(teacher != parts.end());
  if (teacher == parts.end()) return;
  const double added_W = teacher->cut_W - teacher->air_W;
  Values by_law, by_nothing, levels, errors;
  std::size_t seen = 0;
  for (const Part& p : parts) {
    levels.push_back(p.air_W);
    if (p.feed_mm_s == teacher->feed_mm_s) continue;
    const double net = p.cut_W - p.air_W;
    seen += net > 2 * p.error_W ? 1U : 0U;
    by_law.push_back(added_W * p.feed_mm_s / teacher->feed_mm_s - net);
    by_nothing.push_back(net);
    errors.push_back(p.error_W);
  }
  check::figure("wax: parts that are predicted", static_cast<double>(by_law.size()));
  check::figure("wax: power in the air, mean", mean(levels), "W");
  check::figure("wax: its lowest", *std::min_element(levels.begin(), levels.end()), "W");
  check::figure("wax: its highest", *std::max_element(levels.begin(), levels.end()), "W");
  check::figure("wax: what the cut adds in the part that teaches", added_W, "W");
  check::figure("wax: parts whose cut stands out of the air", static_cast<double>(seen));
  check::figure("wax: predicted and measured apart, rms", rms(by_law), "W");
  check::figure("wax: power of the air alone, rms", rms(by_nothing), "W");
  check::figure("wax: how well the air of a part is known, rms", rms(errors), "W");
  CHECK(by_law.size() == 10);
  CHECK_BETWEEN(added_W, 5, 15);
  CHECK(seen <= 2);
  // Nothing is won over what the air is known to: such cuts are not for this drive to tell.
  CHECK_BETWEEN(rms(by_nothing) - rms(by_law), 0, rms(errors));
}

// ----------------------------------------------------------------------------------- turn-mill

/// Neither feeds nor positions: only another part of the same program tells what to expect. How
/// far two parts are apart is what a prediction would be held against.
void turn_mill() {
  const std::string folder = check::outside_data("turnmill-production");
  if (folder.empty()) return;
  // Mean current of each cut of half a second or more, by tool and place among its cuts.
  const auto cuts = [&](const char* name) {
    const fs::path path = fs::path(folder) / name;
    std::ifstream in(path, std::ios::binary);
    std::vector<float> all(fs::file_size(path) / sizeof(float));
    in.read(reinterpret_cast<char*>(all.data()),
            static_cast<std::streamsize>(all.size() * sizeof(float)));
    std::map<std::pair<int, int>, Values> found;
    for (std::size_t i = 0; i + 8 <= all.size(); i += 8) {
      const bool main = std::abs(all[i + 6]) > std::abs(all[i + 7]);
      found[{static_cast<int>(all[i + 2]), static_cast<int>(all[i])}].push_back(
          static_cast<double>(all[i + (main ? 4 : 5)]));
    }
    return found;
  };
  const auto one = cuts("segments_1568211798.f32"), two = cuts("segments_1568213682.f32");
  Values apart;
  for (const auto& [cut, current] : one) {
    const auto other = two.find(cut);
    if (other == two.end() || current.size() < 500 || other->second.size() < 500) continue;
    apart.push_back(mean(other->second) / mean(current) - 1);
  }
  check::figure("turn-mill: cuts of 0.5 s or more in both parts",
                static_cast<double>(apart.size()));
  check::figure("turn-mill: mean current apart, rms", 100 * rms(apart), "%");
  CHECK(apart.size() > 20);
  CHECK_BETWEEN(rms(apart), 0.02, 0.06);
}

}  // namespace

int main() {
  saw();
  wax();
  turn_mill();
  return check::done();
}
