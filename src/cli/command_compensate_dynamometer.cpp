// servosense compensate dynamometer: the force applied to a dynamometer from what it measured.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/sample_period.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/observer/dynamometer_config.hpp"
#include "spindle_angle.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kCompensated = "dynamometer";  // key of the trace's metadata
constexpr double kGap = 1.5;                         // sample periods between two rows
constexpr double kSlowResponse = 0.05;               // |H| of a harmonic that settles late

using Filter = DynamometerFilter<double>;

struct Direction {
  char letter;
  Quantity quantity;
};
constexpr std::array kDirections = {Direction{'x', Quantity::force_x_N},
                                    Direction{'y', Quantity::force_y_N},
                                    Direction{'z', Quantity::force_z_N}};

/// What became of one column.
struct Compensated {
  std::string column;
  std::size_t modes = 0;
  std::size_t harmonics = 0;               // the fewest that were used, once settled
  std::size_t unseen = 0;                  // the most at a zero of the response
  double least_response = 1;               // of those used
  double settled_from_s = 0;               // NaN: never
  double range_before_N = 0, range_N = 0;  // 10th to 90th percentile, once settled
};

double range_of(std::vector<double>& values) {
  if (values.size() < 2) return 0;
  const auto at = [&](double share) {
    const auto place = values.begin() +
                       static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), place, values.end());
    return *place;
  };
  const double high = at(0.9);
  return high - at(0.1);
}

Expected<std::pair<TraceReader, std::vector<TraceRow>>> rows_of(const std::string& path,
                                                                Progress& progress) {
  auto reader = TraceReader::open(path);
  if (!reader) return reader.error();
  if (reader->meta(kCompensated))
    return data_error(path + ": its forces are compensated already; give the record itself");
  std::vector<TraceRow> rows;
  TraceRow row;
  for (;;) {
    auto more = reader->next(row);
    if (!more) return more.error();
    if (!*more) break;
    rows.push_back(row);
    if (rows.size() % 4096 == 0) progress.show(reader->progress() / 2);
  }
  return std::pair(std::move(*reader), std::move(rows));
}

/// Time between two values of a column; 0 with fewer than two.
double period_of(const std::vector<TraceRow>& rows, std::size_t column) {
  std::vector<double> times;
  for (const TraceRow& row : rows)
    if (row.fields[column].state != TraceField::State::empty)
      times.push_back(seconds_from(row.t_ns - rows.front().t_ns));
  return sample_period(times);
}

Compensated compensate(std::vector<TraceRow>& rows, std::size_t column,
                       const std::vector<double>& angle, const DynamometerFilterConfig& config) {
  Filter filter;
  filter.configure(config);
  Compensated out;
  out.modes = config.modes;
  out.harmonics = config.harmonics;
  out.settled_from_s = std::numeric_limits<double>::quiet_NaN();
  std::vector<double> before_N, after_N;
  double last_s = 0, last_angle = 0;
  bool first = true;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    TraceField& field = rows[i].fields[column];
    if (field.state == TraceField::State::empty) continue;
    const double t_s = seconds_from(rows[i].t_ns);
    const double since_s = first ? config.sample_period_s : t_s - last_s;
    const double step = first ? 0 : (angle[i] - last_angle) * config.sample_period_s / since_s;
    const Quality quality = first                                     ? Quality::restarted
                            : since_s > kGap * config.sample_period_s ? Quality::gap
                                                                      : Quality::good;
    const double within = angle[i] - kTwoPi * std::floor(angle[i] / kTwoPi);
    const double measured = field.value;
    const double applied = filter.process(measured, within, step, quality);
    if (field.state == TraceField::State::value) field = TraceField::of(applied);
    const Filter::State& s = filter.state();
    if (!has(s.quality, Quality::settling)) {
      if (!std::isfinite(out.settled_from_s)) out.settled_from_s = t_s;
      out.harmonics = std::min(out.harmonics, s.harmonics);
      out.unseen = std::max(out.unseen, s.unseen);
      out.least_response = std::min(out.least_response, s.slowest);
      if (std::isfinite(measured)) {
        before_N.push_back(measured);
        after_N.push_back(applied);
      }
    }
    last_s = t_s;
    last_angle = angle[i];
    first = false;
  }
  out.range_before_N = range_of(before_N);
  out.range_N = range_of(after_N);
  return out;
}

/// What the filter could not see, in words.
void remark_on(const Compensated& c, const DynamometerFilterConfig& config,
               std::vector<std::string>& remarks) {
  std::array<char, 200> text{};
  if (!std::isfinite(c.settled_from_s)) {
    std::snprintf(text.data(), text.size(),
                  ": the record is shorter than the %.0f turns of the spindle after which it has "
                  "settled; record longer",
                  5 * config.averaged_turns);
    remarks.push_back(c.column + text.data());
    return;
  }
  if (c.harmonics < config.harmonics)
    remarks.push_back(c.column + ": its rate carries " + std::to_string(c.harmonics) +
                      " harmonics of the spindle at the highest speed, of " +
                      std::to_string(config.harmonics) + "; record faster for the others");
  if (c.unseen > 0)
    remarks.push_back(c.column + ": at some speed " + std::to_string(c.unseen) +
                      (c.unseen == 1 ? " harmonic is" : " harmonics are") +
                      " at a zero of the dynamometer's response, which does not report it; it "
                      "stays as it was before");
  if (c.least_response < kSlowResponse) {
    std::snprintf(text.data(), text.size(),
                  ": the dynamometer reports one harmonic by a factor of %.2g only, which settles "
                  "in %.0f turns",
                  c.least_response, 5 * config.averaged_turns / c.least_response);
    remarks.push_back(c.column + text.data());
  }
}

void print_json(const std::vector<Compensated>& all, const std::vector<std::string>& remarks,
                const Arguments& arguments) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("out", arguments.at("--out"));
  json.objects("columns", all, [&](const Compensated& c) {
    json.member("column", c.column);
    json.member("modes", static_cast<double>(c.modes));
    json.member("harmonics", static_cast<double>(c.harmonics));
    json.member("unseen_harmonics", static_cast<double>(c.unseen));
    json.member("least_response", c.least_response);
    json.member("settled_from_s", c.settled_from_s);
    json.member("range_before_N", c.range_before_N);
    json.member("range_N", c.range_N);
  });
  json.values("remarks", remarks);
  json.end_object();
  std::cout << '\n';
}

int run_compensate_dynamometer(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  const std::string& path = arguments.at("--trace");
  std::vector<std::string> remarks;
  std::vector<Compensated> all;
  Progress progress("compensating", arguments.quiet());
  auto read = rows_of(path, progress);
  if (!read) return fail(read.error());
  auto& [reader, rows] = *read;
  if (rows.size() < 2)
    return fail(data_error(path + ": fewer than two rows; give a record of cuts"));
  std::vector<double> angle;
  std::string without_modes;
  for (const Direction& d : kDirections) {
    const auto column = reader.column({Channel::dyno, d.quantity});
    if (!column) continue;
    const std::string name = column_name({Channel::dyno, d.quantity});
    const double period_s = period_of(rows, *column);
    if (!(period_s > 0)) return fail(data_error(path + ": " + name + " has fewer than two values"));
    auto config = dynamometer_config(*machine, d.letter, period_s);
    if (!config) return fail(config.error());
    if (!*config) {
      without_modes += (without_modes.empty() ? "" : ", ") + name;
      continue;
    }
    if (angle.empty()) {
      auto turned = spindle_angle(reader.signals(), rows, *machine, path);
      if (!turned) return fail(turned.error());
      angle = std::move(turned->angle_rad);
      if (!turned->remark.empty()) remarks.push_back(turned->remark);
    }
    Compensated done = compensate(rows, *column, angle, **config);
    done.column = name;
    remark_on(done, **config, remarks);
    all.push_back(std::move(done));
    progress.show(0.5 + static_cast<double>(all.size()) / 8);
  }
  if (all.empty() && without_modes.empty())
    return fail(data_error(path + ": there is no column dyno.force_x_N, force_y_N or force_z_N"));
  if (all.empty())
    return fail(data_error(machine->where("dynamometer.x") + ": no modes for " + without_modes +
                           "; give [dynamometer.x] modes, and those of y and z"));
  if (!without_modes.empty())
    remarks.push_back(without_modes + ": the machine file has no modes of it; it stays as it is");
  TraceMetadata metadata = reader.metadata();
  metadata.emplace_back(kCompensated, "compensated by servosense compensate dynamometer");
  auto writer = TraceWriter::create(arguments.at("--out"), reader.signals(), metadata);
  if (!writer) return fail(writer.error());
  for (const TraceRow& row : rows)
    if (auto done = writer->write(row.t_ns, row.fields); !done) return fail(done.error());
  if (auto done = writer->close(); !done) return fail(done.error());
  for (const std::string& remark : remarks) note(remark, arguments.quiet());
  if (arguments.json()) {
    print_json(all, remarks, arguments);
    return 0;
  }
  say("%-16s %6s %10s %14s %16s %12s\n", "column", "modes", "harmonics", "settled from s",
      "10-90 % before N", "after N");
  for (const Compensated& c : all)
    say("%-16s %6zu %10zu %14.3f %16.4g %12.4g\n", c.column.c_str(), c.modes, c.harmonics,
        c.settled_from_s, c.range_before_N, c.range_N);
  say("written to %s\n", arguments.at("--out").c_str());
  return 0;
}

}  // namespace

Program compensate_dynamometer_program() {
  return {{"compensate dynamometer",
           "the force applied to a dynamometer, from what it measured",
           {{"--machine", "FILE", "machine file with the modes of the dynamometer", true,
             FileUse::input},
            {"--trace", "FILE", "record with dyno.force_x_N (y, z) and the spindle's angle", true,
             FileUse::input},
            {"--out", "FILE", "the record with the forces compensated", true, FileUse::output}},
           "",
           "A dynamometer swings at its own natural frequencies. [dynamometer.x] modes (y, z) are\n"
           "natural frequency, damping ratio and share of the static gain of each. The force is\n"
           "found again at the harmonics of the spindle; what does not repeat with its turn is\n"
           "averaged out over [dynamometer] averaged_turns."},
          run_compensate_dynamometer};
}

}  // namespace servosense::cli
