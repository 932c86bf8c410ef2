// servosense study encoder: what counts alone put into the estimate of torque and force.
#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/encoder_study.hpp"
#include "servosense/observer/drive_config.hpp"
#include "study_page.hpp"

namespace servosense::cli {
namespace {

// Koike 2016, tables 3-1 and 3-6, sec. 3.3.
const EncoderStudyDrive kSpindle{0.0048, kTwoPi, rad_s_from_rpm(16000)};
const EncoderStudyDrive kStage{380, 0.016, 50.0 / 60};
constexpr std::array kCutoffs_rad_s = {1000.0, 2000.0, 3000.0, 3500.0, 4000.0};
constexpr int kLeastBits = 10, kMostBits = 24;

struct NoisePoint {
  const char* drive;
  double cutoff_rad_s;
  int bits;
  double amplitude;
};

/// A drive of the machine file at its own encoder and cutoff.
struct OwnDrive {
  Channel channel = Channel::x;
  EncoderStudyDrive drive;
  double counts = 0, cutoff_rad_s = 0, amplitude = 0;
};

std::vector<NoisePoint> all_points() {
  std::vector<NoisePoint> all;
  for (const bool spindle : {true, false})
    for (const double cutoff : kCutoffs_rad_s)
      for (int bits = kLeastBits; bits <= kMostBits; ++bits)
        all.push_back({spindle ? "spindle" : "stage", cutoff, bits,
                       encoder_noise(spindle ? kSpindle : kStage, std::ldexp(1, bits), cutoff)});
  return all;
}

double noise_at(const std::vector<NoisePoint>& all, const std::string& drive, double cutoff,
                int bits) {
  const auto found = std::find_if(all.begin(), all.end(), [&](const NoisePoint& p) {
    return p.drive == drive && p.cutoff_rad_s == cutoff && p.bits == bits;
  });
  return found == all.end() ? std::nan("") : found->amplitude;
}

std::vector<Compared> encoder_compared(const std::vector<NoisePoint>& all) {
  int least = kLeastBits;
  while (least < kMostBits && noise_at(all, "spindle", 4000, least) >= 1) ++least;
  const double halving =
      std::pow(noise_at(all, "stage", 4000, 20) / noise_at(all, "stage", 4000, 10), 0.1);
  return {{"fewest bits of a spindle at 16000 rpm that resolve 1 Nm at 4000 rad/s", "=", 17,
           static_cast<double>(least), "bits", "Koike 2016, fig. 3-4"},
          {"spindle of 17 bits at 3500 rad/s", "<", 1, noise_at(all, "spindle", 3500, 17), "Nm",
           "Koike 2016, sec. 3.3"},
          {"stage of 380 kg and 20 bits at 50 m/min and 4000 rad/s", "=", 36,
           noise_at(all, "stage", 4000, 20), "N", "Koike 2016, fig. 3-5"},
          {"factor of one bit more, stage, 10 to 20 bits", "=", 0.5, halving, "",
           "Koike 2016, sec. 3.3"}};
}

/// Highest mean speed over a stretch: between two samples it is a whole number of counts, at which
/// an encoder has no noise.
double fastest_in(const StudyRecords& records, Channel channel) {
  constexpr std::size_t kStretch = 101;
  double highest = 0;
  for (const DriveRecord& r : records.records)
    if (r.channel == channel)
      for (std::size_t i = kStretch; i < r.samples.size(); ++i)
        highest =
            std::max(highest, std::abs(r.samples[i].position - r.samples[i - kStretch].position) /
                                  (static_cast<double>(kStretch) * r.sample_period_s));
  return highest;
}

Expected<std::vector<OwnDrive>> own_drives(const Arguments& arguments) {
  std::vector<OwnDrive> all;
  const auto path = arguments.value("--machine");
  if (!path) {
    if (arguments.has("--trace"))
      return usage_error("--trace tells how fast the drives of --machine turn; give both");
    return all;
  }
  const auto machine = MachineFile::read(*path);
  if (!machine) return machine.error();
  std::optional<StudyRecords> records;
  if (const auto trace = arguments.value("--trace")) {
    auto read = study_records(*machine, *trace, arguments.quiet());
    if (!read) return read.error();
    records = std::move(*read);
  }
  for (const Channel channel : kDriveChannels) {
    const std::string section(section_of(channel));
    const auto counts = machine->number(section, "encoder_counts_per_rev");
    const auto inertia =
        machine->number(section, is_linear_axis(channel) ? "equivalent_mass_kg" : "inertia_kg_m2");
    const auto lead = machine->number(section, "lead_m");
    if (!counts || !inertia || (is_linear_axis(channel) && !lead)) continue;
    OwnDrive own;
    own.channel = channel;
    own.counts = *counts;
    own.cutoff_rad_s =
        machine->number("observer." + std::string(name_of(channel)), "disturbance_cutoff_rad_s")
            .value_or(ObserverCutoffs{}.disturbance_cutoff_rad_s);
    own.drive = {*inertia, is_linear_axis(channel) ? *lead : kTwoPi,
                 is_linear_axis(channel)
                     ? machine->number(section, "max_velocity_m_s").value_or(kStage.speed)
                     : kSpindle.speed,
                 1 / machine->number("machine", "sample_rate_hz").value_or(8000)};
    if (records)
      if (const double speed = fastest_in(*records, channel); speed > 0) own.drive.speed = speed;
    if (own.cutoff_rad_s * own.drive.sample_period_s >= 2)
      return data_error(*path + ": [observer." + std::string(name_of(channel)) +
                        "] disturbance_cutoff_rad_s is too high for [machine] sample_rate_hz; "
                        "lower it below twice that rate");
    own.amplitude = encoder_noise(own.drive, own.counts, own.cutoff_rad_s);
    all.push_back(own);
  }
  if (all.empty())
    return data_error(*path +
                      ": no drive has encoder_counts_per_rev and its inertia or mass; add them");
  return all;
}

const char* estimate_unit(Channel c) { return is_turning(c) ? "Nm" : "N"; }

report::Plot encoder_picture(const std::vector<NoisePoint>& all, const std::string& drive,
                             const std::string& unit) {
  report::Plot plot;
  plot.title = drive == "spindle" ? "Spindle, 16000 rpm" : "Stage of 380 kg, 50 m/min";
  plot.x_label = "encoder", plot.x_unit = "bits";
  plot.y_label = "largest line of the estimate", plot.log_y = true;
  for (const double cutoff : kCutoffs_rad_s) {
    report::Series s;
    s.name = report::Cell(cutoff, 4).text + " rad/s", s.unit = unit;
    for (const NoisePoint& p : all)
      if (p.drive == drive && p.cutoff_rad_s == cutoff) {
        s.x.push_back(p.bits);
        s.y.push_back(p.amplitude);
      }
    plot.series.push_back(std::move(s));
  }
  plot.limits = {drive == "spindle"
                     ? report::Limit{1, "1 Nm", report::Level::info}
                     : report::Limit{36, "36 N, published for 20 bits", report::Level::info}};
  return plot;
}

int run_study_encoder(const Arguments& arguments) {
  const auto own = own_drives(arguments);
  if (!own) return fail(own.error());
  const std::vector<NoisePoint> all = all_points();
  const std::vector<Compared> rows = encoder_compared(all);
  if (const auto path = arguments.value("--report")) {
    report::Report page("Encoder resolution and what it lets be seen", "Koike 2016, sec. 3.3");
    page.add(report::Paragraph{
        "At constant speed the angle is cut to counts and nothing else acts: the largest line of "
        "the estimate is what a line of a cut must exceed. It falls by about half with every bit "
        "and rises with the cutoff."});
    page.add(compared_table(rows));
    page.add(encoder_picture(all, "spindle", "Nm")).add(encoder_picture(all, "stage", "N"));
    report::Table table{
        "This machine",
        "At the speed and the cutoff of each drive.",
        {"drive", "counts per turn", "cutoff [rad/s]", "speed", "largest line", ""}};
    for (const OwnDrive& d : *own)
      table.rows.push_back({{std::string(name_of(d.channel)), report::Cell(d.counts, 8),
                             report::Cell(d.cutoff_rad_s, 4), report::Cell(d.drive.speed, 4),
                             report::Cell(d.amplitude, 3), estimate_unit(d.channel)},
                            report::Level::none});
    if (!own->empty()) page.add(std::move(table));
    if (auto done = page.write(*path); !done) return fail(done.error());
  }
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    write_compared(json, rows);
    json.objects("noise", all, [&](const NoisePoint& p) {
      json.member("drive", p.drive);
      json.member("cutoff_rad_s", p.cutoff_rad_s);
      json.member("bits", p.bits);
      json.member("amplitude", p.amplitude);
    });
    json.objects("drives", *own, [&](const OwnDrive& d) {
      json.member("channel", name_of(d.channel));
      json.member("counts_per_turn", d.counts);
      json.member("cutoff_rad_s", d.cutoff_rad_s);
      json.member("speed", d.drive.speed);
      json.member("amplitude", d.amplitude);
      json.member("unit", estimate_unit(d.channel));
    });
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say_compared(rows);
  for (const OwnDrive& d : *own)
    say("  %s: %.8g counts at %.4g %s and %.4g rad/s leave a line of %.3g %s\n",
        std::string(name_of(d.channel)).c_str(), d.counts, d.drive.speed,
        is_turning(d.channel) ? "rad/s" : "m/s", d.cutoff_rad_s, d.amplitude,
        estimate_unit(d.channel));
  return 0;
}

}  // namespace

Program study_encoder_program() {
  return {{"study encoder", "encoder resolution against the torque and force that can be seen",
           study_options({}, "trace whose highest speeds are taken for those of the drives"), "",
           "Koike 2016, sec. 3.3, with its published figures beside. Without --trace an axis moves "
           "at its\n"
           "max_velocity_m_s, else at 50 m/min, and a spindle turns at 16000 rpm."},
          run_study_encoder};
}

}  // namespace servosense::cli
