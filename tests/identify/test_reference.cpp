// Parts of the comparison with a sound reference: how a record is cut into windows, amplitudes of
// orders and bands in closed form, what tells a cut from air, the middle of three, the file.
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <random>
#include <sstream>

#include "check.hpp"
#include "io/malformed.hpp"
#include "reference_cuts.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/learn_reference.hpp"
#include "servosense/io/text.hpp"

using namespace servosense;
namespace fs = std::filesystem;

namespace {

fs::path folder;

constexpr Signal kCurrent{Channel::spindle, Quantity::current_A};
constexpr Signal kAngle{Channel::spindle, Quantity::angle_rad};

ReferenceLayout plain(double rate_hz, double window_s) {
  ReferenceLayout layout;
  layout.sample_rate_hz = rate_hz;
  layout.window_s = window_s;
  layout.signals = {{kCurrent, 1}};
  return layout;
}

/// Windows of a record whose signal is `value(t)`; `gap_from`, `gap_to`: rows that are missing.
template <typename Value>
std::vector<ReferenceWindow> windows(const ReferenceLayout& layout, double seconds,
                                     double speed_rad_s, Value value, double gap_from = 1e9,
                                     double gap_to = 1e9) {
  ReferenceCutter cutter(layout, {kAngle, kCurrent}, {.column = std::size_t{0}});
  std::vector<ReferenceWindow> all;
  const auto rows = static_cast<long>(std::lround(seconds * layout.sample_rate_hz));
  for (long n = 0; n < rows; ++n) {
    const double t = static_cast<double>(n) / layout.sample_rate_hz;
    if (t >= gap_from && t < gap_to) continue;
    TraceRow row;
    row.t_ns = nanoseconds_from(t);
    // An encoder that begins anew with every turn.
    row.fields = {TraceField::of(std::fmod(speed_rad_s * t, kTwoPi)), TraceField::of(value(t))};
    for (auto& w : cutter.add(row)) all.push_back(std::move(w));
  }
  for (auto& w : cutter.finish()) all.push_back(std::move(w));
  return all;
}

/// Value of the feature of that name.
double feature(const ReferenceLayout& layout, const ReferenceWindow& w, const std::string& name) {
  const auto features = reference_features(layout);
  for (std::size_t j = 0; j < features.size(); ++j)
    if (name_of(layout, features[j]) == name) return w.values[j];
  return std::nan("");
}

// From the first to the last sample, without a gap between them, whatever is missing inside.
void windows_tile() {
  for (const bool hole : {false, true}) {
    const ReferenceLayout layout = plain(1000, 0.1);
    const auto all = hole ? windows(
                                layout, 2.05, 0, [](double) { return 1.0; }, 0.73, 1.38)
                          : windows(layout, 2.05, 0, [](double) { return 1.0; });
    CHECK(all.size() == (hole ? 17 : 21));
    CHECK(all.front().from_s == 0);
    CHECK_NEAR(all.back().to_s, 2.049, 1e-9);
    for (std::size_t i = 1; i < all.size(); ++i) CHECK(all[i].from_s == all[i - 1].to_s);
    std::size_t few = 0;
    for (const auto& w : all) few += w.why == NotCompared::too_few_samples;
    CHECK(few == (hole ? 4 : 1));  // cut short at the end; before, in and behind the hole
  }
}

// Sinusoids of known amplitude at orders of the rotation and beside them.
void orders_and_bands() {
  ReferenceLayout layout = plain(4000, 0.25);
  layout.speed_rad_s = 2 * kPi * 40;
  layout.teeth = 3;
  std::mt19937 random(11);
  for (int round = 0; round < 20; ++round) {
    const double slip = std::uniform_real_distribution<double>(0.97, 1.03)(random);
    const double a1 = std::uniform_real_distribution<double>(0.2, 1)(random);
    const double a3 = std::uniform_real_distribution<double>(0.2, 1)(random);
    const double off = std::uniform_real_distribution<double>(0.2, 1)(random);
    const double turn = layout.speed_rad_s * slip;
    const auto all = windows(layout, 0.25, turn, [&](double t) {
      return 5 + a1 * std::cos(turn * t + 1) + a3 * std::cos(3 * turn * t + 2) +
             off * std::sin(17.5 * turn * t);
    });
    const ReferenceWindow& w = all.front();
    // What a part of a turn leaves of order 1: 1 / (pi 10 turns).
    CHECK_NEAR(feature(layout, w, "spindle.current_A level"), 5, 0.035);
    CHECK_NEAR(std::exp(feature(layout, w, "spindle.current_A order 1")), a1, 0.02 * a1 + 0.01);
    CHECK_NEAR(std::exp(feature(layout, w, "spindle.current_A order 3")), a3, 0.02 * a3 + 0.01);
    CHECK(std::exp(feature(layout, w, "spindle.current_A orders between")) < 0.05);
    // Near the middle of its octave; the line that does not turn alone is left.
    CHECK_NEAR(std::exp(feature(layout, w, "spindle.current_A band 707.1 Hz")),
               off / std::sqrt(2.0), 0.08 * off);
    CHECK(std::exp(feature(layout, w, "spindle.current_A band 176.8 Hz")) < 0.08);
    CHECK_NEAR(std::exp(feature(layout, w, "spindle.current_A swing")),
               std::sqrt((a1 * a1 + a3 * a3 + off * off) / 2), 0.03);
  }
  // A speed that changes within the window keeps it from being compared.
  const auto all = windows(layout, 0.25, 0, [](double) { return 5.0; });
  CHECK(all.front().why == NotCompared::other_speed);  // it stands
}

// Air, entry, cut, exit, air.
void cut_and_air() {
  ReferenceLayout layout = plain(1000, 0.1);
  layout.cutting_level = 2;
  const auto all = windows(layout, 1, 0, [](double t) { return t > 0.25 && t < 0.75 ? 5.0 : 1.0; });
  const NotCompared expected[] = {NotCompared::not_cutting,
                                  NotCompared::not_cutting,
                                  NotCompared::entry_or_exit,
                                  NotCompared::no,
                                  NotCompared::no,
                                  NotCompared::no,
                                  NotCompared::no,
                                  NotCompared::entry_or_exit,
                                  NotCompared::not_cutting};
  CHECK(all.size() == 10);
  for (std::size_t i = 0; i < 9; ++i) CHECK(all[i].why == expected[i]);
}

void middle_of_three() {
  ThreeInARow three;
  CHECK(three.add(1).empty());
  CHECK(three.add(9).empty());
  CHECK(three.add(2) == (std::vector<double>{2, 2, 2}));
  CHECK(three.add(3) == std::vector<double>{3});  // of 9, 2, 3
  CHECK(three.add(8) == std::vector<double>{3});
  CHECK(three.add(8) == std::vector<double>{8});
  three.interrupt();
  CHECK(three.add(7).empty());
}

std::optional<LearnedReference> learned(int records, unsigned seed) {
  std::mt19937 random(seed);
  reference_cuts::Job job = reference_cuts::any_job(random);
  const std::string ini = (folder / "m.ini").string();
  reference_cuts::machine(ini, job);
  std::vector<std::string> traces;
  for (int r = 0; r < records; ++r) {
    traces.push_back((folder / ("sound" + std::to_string(r) + ".csv")).string());
    reference_cuts::record(traces.back(), job, reference_cuts::any_sound(random),
                           reference_cuts::Fault::none, 0, seed + static_cast<unsigned>(r));
  }
  const auto machine = MachineFile::read(ini);
  auto out = learn_reference(*machine, traces);
  CHECK(out);
  if (!out) return std::nullopt;
  return *std::move(out);
}

Expected<Reference> parsed(const std::string& text) {
  LineReader lines(std::make_unique<std::istringstream>(text), "r.txt");
  return read_reference(lines);
}

// The file holds all of it: distances from what was read are those from what was learned.
void file_there_and_back() {
  const auto made = learned(3, 5);
  if (!made) return;
  const std::string text = reference_text(made->reference, {"a remark"});
  const auto read = parsed(text);
  CHECK(read);
  if (!read) return;
  CHECK(reference_text(*read, {"a remark"}) == text);
  const std::vector<bool> all(read->layout.signals.size(), true);
  const auto a = ReferenceDistance::learn(made->reference, all);
  const auto b = ReferenceDistance::learn(*read, all);
  CHECK(a && b);
  if (!a || !b) return;
  CHECK(a->threshold() == b->threshold());
  const auto first = made->reference.sound.front().window;
  CHECK(a->compare(first)->distance == b->compare(first)->distance);
  // A single column less: another distance, no refusal.
  std::vector<bool> less = all;
  less.back() = false;
  const auto without = ReferenceDistance::learn(*read, less);
  CHECK(without);
  CHECK(without && without->compare(first)->distance != b->compare(first)->distance);
  CHECK(!ReferenceDistance::learn(*read, std::vector<bool>(all.size(), false)));

  // What was changed by hand is found, with its line.
  const auto wrong = [&](const std::string& part, const std::string& by, const std::string& says) {
    std::string other = text;
    const std::size_t at = other.find(part);
    CHECK(at != std::string::npos);
    other.replace(at, part.size(), by);
    const auto e = parsed(other);
    const std::string sentence = e ? "no error" : e.error().sentence;
    check::that(sentence.starts_with("r.txt:") && sentence.find(says) != std::string::npos,
                (part + " -> " + by + ": " + sentence).c_str(), __FILE__, __LINE__);
  };
  wrong("reference 1", "reference 2", "expected the format");
  wrong("window_s = ", "window_s = -", "window_s must be a number");
  wrong("teeth = ", "teeth = 0.5", "teeth must be");
  wrong("blocks = no", "blocks = maybe", "blocks must be yes or no");
  wrong("machine = ", "engine = ", "unknown key 'engine'");
  wrong("false_alarms = ", "window_s = ", "stands twice");
  wrong("cutting_level = ", "# ", "expected the key cutting_level");
  wrong("effort = spindle", "effort = y", "one of the signals");
  wrong("signals = spindle.", "signals = spindel.", "no column of a trace");
  wrong("scales = ", "scales = 0, ", "positive numbers");
  wrong("trace,from_s", "from_s,trace", "the columns are not those");
  wrong("\n1,", "\n9,", "trace must be the number");
  wrong("\n1,", "\n1.5,", "trace must be the number");
  wrong("\n1,", "\n1,1,", "columns, not");
  wrong("\n2,", "\n1,", "in the order of traces and of time");
  wrong("\n1,", "\nnan,", "expected a number");
  CHECK(!parsed(""));
  CHECK(!parsed(text.substr(0, text.find("trace,from_s"))));
}

// Too little is refused; what does not go together, too.
void refusals() {
  std::mt19937 random(3);
  reference_cuts::Job job = reference_cuts::any_job(random);
  const std::string ini = (folder / "m.ini").string(), one = (folder / "one.csv").string(),
                    two = (folder / "two.csv").string();
  reference_cuts::machine(ini, job);
  const auto machine = MachineFile::read(ini);
  job.cut_s = 0.2;
  reference_cuts::record(one, job, {}, reference_cuts::Fault::none, 0, 1);
  const auto little = learn_reference(*machine, {one});
  CHECK(little);
  if (little) {
    const auto distance = ReferenceDistance::learn(
        little->reference, std::vector<bool>(little->reference.layout.signals.size(), true));
    CHECK(!distance && distance.error().sentence.find("record more") != std::string::npos);
  }
  job.rate_hz *= 2;
  reference_cuts::record(two, job, {}, reference_cuts::Fault::none, 0, 1);
  const auto mixed = learn_reference(*machine, {one, two});
  CHECK(!mixed && mixed.error().sentence.find("one sample rate") != std::string::npos);
  std::ofstream(two) << "t_s,spindle.angle_rad\n0,0\n0.001,1\n0.002,2\n0.003,3\n";
  const auto nothing = learn_reference(*machine, {two});
  CHECK(!nothing && nothing.error().sentence.find("no current, torque") != std::string::npos);
  std::ofstream(two) << "t_s,spindle.current_A\n0,0\n";
  CHECK(!learn_reference(*machine, {two}));
  CHECK(!learn_reference(*machine, {(folder / "absent.csv").string()}));
}

}  // namespace

int main() {
  folder = fs::temp_directory_path() / ("servosense_reference_" + std::to_string(::getpid()));
  fs::create_directories(folder);
  windows_tile();
  orders_and_bands();
  cut_and_air();
  middle_of_three();
  file_there_and_back();
  refusals();
  malformed::check_all("reference_file", 14, [](const std::string& path) {
    const auto r = read_reference(path);
    return r ? Error{ErrorKind::data, ""} : r.error();
  });
  fs::remove_all(folder);
  return check::done();
}
