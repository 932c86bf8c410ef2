// Reconcile on every recorded drive whose channels allow it: what the record supports, and no name
// beyond that. Sets without parameters are identified first. Not one of these was recorded for this
// purpose, so most answers are refusals or gaps without a name; the table is the one of
// docs/reconcile-records.md.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <string>
#include <vector>

#include "cli/program.hpp"
#include "servosense/io/trace.hpp"

namespace {

namespace fs = std::filesystem;
using namespace program_test;
using Names = std::set<std::string>;

const Names kNone;
// One sense of friction beside the other: a load, or friction that differs.
const Names kByDirection{"constant-load", "asymmetric-friction", "coulomb-friction"};

fs::path machines;  // examples/machines

struct Answer {
  bool refused = false;
  std::string sentence, named;
  std::vector<Names> effects;  // each with its class
};

Answer reconcile(const std::string& machine, const fs::path& trace, const std::string& channel) {
  const Outcome o = run("reconcile --quiet --machine '" + machine + "' --trace '" + trace.string() +
                        "' --channel " + channel + " --out found --json");
  Answer a;
  if (o.status != 0) {
    that(o.status == 3 && one_sentence(o.err), o, "refused in one sentence", __LINE__);
    a.refused = true;
    a.sentence = o.err.substr(std::string("servosense: ").size());
    a.sentence.pop_back();
    return a;
  }
  const Json json(o.out);
  that(json.ok && json.object, o, "one JSON object", __LINE__);
  a.sentence = json.text("summary");
  // A floor of nothing would let everything through; a gap beyond the effort is no model.
  that(json.number("noise_floor") > 0, o, "a noise floor", __LINE__);
  that(json.number("gap_before") < json.number("effort_rms"), o, "a gap below the effort",
       __LINE__);
  const auto count = [&](const std::string& path) {
    const auto found = json.sizes.find(path);
    return found == json.sizes.end() ? std::size_t{0} : found->second;
  };
  for (std::size_t i = 0; i < count("effects"); ++i) {
    const std::string at = "effects." + std::to_string(i);
    a.named += (a.named.empty() ? "" : ", ") + json.text(at + ".name");
    Names names{json.text(at + ".name")};
    for (std::size_t k = 0; k < count(at + ".class"); ++k) {
      names.insert(json.text(at + ".class." + std::to_string(k)));
      a.named += " or " + json.text(at + ".class." + std::to_string(k));
    }
    that(names.size() <= 3, o, "a class of three at most", __LINE__);
    a.effects.push_back(std::move(names));
  }
  return a;
}

/// The traces of a set whose name holds `part`; none, said aloud, when the set is not there.
std::vector<fs::path> traces(const std::string& set, const std::string& part) {
  const std::string from = check::outside_data(set);
  if (from.empty()) return {};
  const fs::path out = folder / fs::path(set).filename();
  if (!fs::exists(out)) {
    const fs::path converter = fs::path(program).parent_path() / "examples/recorded_data";
    const std::string command = "'" + converter.string() + "' " + out.filename().string() + " '" +
                                from + "' '" + out.string() + "' > /dev/null";
    CHECK(std::system(command.c_str()) == 0);
  }
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(out))
    if (contains(entry.path().filename().string(), part)) found.push_back(entry.path());
  std::sort(found.begin(), found.end());
  CHECK(!found.empty());
  return found;
}

/// Torque per ampere beyond 350 rad/s over that below 150 rad/s, from differences over 40 ms alone:
/// the acceleration between rising and falling speed over the effort between them, in which
/// friction and every load of the speed cancel.
double force_constant_at_speed(const fs::path& path) {
  const auto trace = servosense::read_trace(path.string());
  CHECK(trace.has_value());
  if (!trace) return 1;
  const auto column = [&](servosense::Quantity quantity) {
    for (std::size_t k = 0; k < trace->signals.size(); ++k)
      if (trace->signals[k] == servosense::Signal{servosense::Channel::spindle, quantity})
        return trace->columns[k];
    CHECK(false);
    return std::vector<double>(trace->t_s.size());
  };
  const auto speed = column(servosense::Quantity::speed_rad_s);
  const auto effort = column(servosense::Quantity::current_A);
  constexpr std::size_t kSide = 20;
  struct Mean {
    double acceleration = 0, effort = 0, n = 0;
  };
  Mean rising[2], falling[2];
  for (std::size_t i = kSide; i + kSide < speed.size(); ++i) {
    const double a =
        (speed[i + kSide] - speed[i - kSide]) / (trace->t_s[i + kSide] - trace->t_s[i - kSide]);
    const double w = std::abs(speed[i]);
    if (std::abs(a) < 100 || (w >= 150 && w < 350)) continue;
    Mean& m = (a > 0 ? rising : falling)[w >= 350];
    m.acceleration += a, m.effort += effort[i], ++m.n;
  }
  double constant[2];
  for (const int fast : {0, 1}) {
    const Mean &up = rising[fast], &down = falling[fast];
    CHECK(up.n > 200 && down.n > 200);  // 0.2 s of each
    constant[fast] = (up.acceleration / up.n - down.acceleration / down.n) /
                     (up.effort / up.n - down.effort / down.n);
  }
  std::printf("torque per ampere beyond 350 rad/s: %.3f of that below 150 rad/s\n",
              constant[1] / constant[0]);
  return constant[1] / constant[0];
}

struct Expected {
  std::string set, traces, machine, channel;
  bool refused = false;           // always
  Names allowed{};                // no other effect, nor class without one of them, may be named
  bool identified_first = false;  // the set publishes no parameters
};

void judge(const Expected& e) {
  for (const fs::path& trace : traces(e.set, e.traces)) {
    std::string machine = (machines / (e.machine + ".ini")).string();
    Answer a;
    if (e.identified_first) {
      const Outcome o = run("identify idle --quiet --machine '" + machine + "' --trace '" +
                            trace.string() + "' --out learned.ini");
      machine = (folder / "learned.ini").string();
      if (o.status != 0) {
        that(o.status == 3 && one_sentence(o.err), o, "refused in one sentence", __LINE__);
        a.refused = true;
        a.sentence = "identify idle: " + o.err.substr(std::string("servosense: ").size());
        a.sentence.pop_back();
      }
    }
    if (!a.refused) a = reconcile(machine, trace, e.channel);
    const std::string what = trace.filename().string() + ", " + e.channel + ": ";
    for (const Names& names : a.effects) {
      const bool right = std::any_of(names.begin(), names.end(), [&](const std::string& name) {
        return e.allowed.contains(name);
      });
      check::that(right, (what + a.named).c_str(), __FILE__, __LINE__);
    }
    if (e.refused) check::that(a.refused, (what + a.sentence).c_str(), __FILE__, __LINE__);
    std::printf("| %s | %s | %s |\n", trace.filename().c_str(),
                a.named.empty() ? (a.refused ? "refused" : "none") : a.named.c_str(),
                a.sentence.c_str());
  }
}

void drives() {
  machines = fs::current_path() / "examples/machines";
  // Torque steps of a motor that turns one way.
  judge({"nolicence/servo-torque-hsm150", "_commanded", "hsm150", "spindle", true});
  // A motor without load whose Coulomb friction is twice the published one. The same rig shows
  // presliding, and plain least squares find orders 5 and 10 of the turn above all others in its
  // three records of free motion.
  Names lugre = kByDirection;
  lugre.insert("presliding-hysteresis");
  lugre.insert("torque-ripple");
  judge({"nolicence/lugre-servo-motor", "J_", "lugre_servo", "spindle", false, lugre});
  judge({"nolicence/lugre-servo-motor", "Fs_", "lugre_servo", "spindle", true});
  judge({"nolicence/lugre-servo-motor", "sigma0_", "lugre_servo", "spindle", true});
  judge({"nolicence/lugre-direct-drive", "j1_01_exp", "lugre_servo", "spindle", true});
  // Production and milling: the effort holds the cut, which is no effect of the drive.
  const std::string turnmill = "turnmill-production",
                    file = "../../tests/data/machine/turnmill_drive";
  for (const char* part : {"main", "segments"})
    judge({turnmill, part, file, "spindle", false, kNone});
  // The sub spindle reverses from 5000 rpm to 5000 rpm and has half the torque per ampere up there.
  for (const fs::path& trace : traces(turnmill, "dev_sub.csv"))
    if (contains(trace.filename().string(), "part_")) CHECK(force_constant_at_speed(trace) < 0.6);
  judge({turnmill, "part_20181023_dev_sub", file, "spindle", false, {"field-weakening"}});
  judge({"umich-cnc-mill", "experiment_01", "umich", "x", false, kNone, true});
  judge({"umich-cnc-mill", "experiment_01", "umich", "y", false, kNone, true});
  judge({"umich-cnc-mill", "experiment_17", "umich", "y", false, kNone, true});
  // One joint moves at a time.
  judge({"nolicence/ur10e-friction-collision", "joint_1_joint", "ur10e", "spindle", false, kNone,
         true});
}

}  // namespace

int main() { return in_own_folder("recorded_drives", drives); }
