// Turns recorded sets that others have published into trace files.
//
//   recorded_data <set> <source folder> <out folder>
//
// docs/recorded-data.md says what each set is, where it comes from, and what its traces hold.
// Nothing is filtered or resampled: a column is copied, scaled to SI, or left out because its
// meaning is not published. What was assumed stands in the metadata of each trace.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <istream>
#include <iterator>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/binary_matrix.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"

namespace fs = std::filesystem;
using namespace servosense;

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// ---------------------------------------------------------------------------- reading the sources

using Series = std::vector<double>;

/// A source file as named columns. What is not a number (labels) becomes NaN.
struct Table {
  std::string file;
  std::vector<std::string> names;
  std::vector<Series> columns;
  double rate_hz = 0;  ///< 0: not stated

  [[nodiscard]] std::size_t rows() const { return columns.empty() ? 0 : columns.front().size(); }
  [[nodiscard]] Expected<Series> column(std::string_view name) const {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end())
      return data_error(file + ": has no column " + in_quotes(name) +
                        "; is this the set that was named?");
    return columns[static_cast<std::size_t>(found - names.begin())];
  }
};

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> fields;
  for (std::size_t comma; (comma = line.find(',')) != line.npos; line.remove_prefix(comma + 1))
    fields.push_back(trim(line.substr(0, comma)));
  fields.push_back(trim(line));
  return fields;
}

/// Comma separated text with one header line; '#' begins a comment line.
Expected<Table> read_csv(const fs::path& path) {
  auto stream = open_for_reading(path.string());
  if (!stream) return stream.error();
  LineReader lines(std::move(*stream), path.string());
  Table table{path.string(), {}, {}};
  std::string_view line;
  for (;;) {
    auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) break;
    if (trim(line).empty() || line.front() == '#') continue;
    const auto fields = split(line);
    if (table.names.empty()) {
      table.names.assign(fields.begin(), fields.end());
      table.columns.resize(fields.size());
      continue;
    }
    if (fields.size() != table.names.size())
      return lines.error_here("expected " + std::to_string(table.names.size()) +
                              " fields as in the header, found " + std::to_string(fields.size()));
    for (std::size_t i = 0; i < fields.size(); ++i) {
      const auto number = parse_number(fields[i]);
      table.columns[i].push_back(number.ok() ? number.value : kNone);
    }
  }
  if (table.rows() == 0) return data_error(table.file + ": holds no rows; fetch it again");
  return table;
}

Expected<Table> read_f32(const fs::path& path) {
  auto matrix = BinaryMatrix::open(path.string());
  if (!matrix) return matrix.error();
  Table table{path.string(), {}, {}};
  table.rate_hz = matrix->header().rate_hz;
  for (const auto& channel : matrix->header().channels) table.names.push_back(channel.name);
  table.columns.resize(table.names.size());
  std::vector<float> row(table.names.size());
  for (;;) {
    const auto more = matrix->next(row);
    if (!more) return more.error();
    if (!*more) return table;
    for (std::size_t i = 0; i < row.size(); ++i)
      table.columns[i].push_back(static_cast<double>(row[i]));
  }
}

/// A .wav file of one channel, 16-bit PCM: `sound` as a part of full scale.
Expected<Table> read_wav(const fs::path& path) {
  auto stream = open_for_reading(path.string());
  if (!stream) return stream.error();
  const std::string bytes{std::istreambuf_iterator<char>(**stream), {}};
  const auto unsigned_at = [&](std::size_t at, std::size_t size) {
    std::uint32_t value = 0;
    for (std::size_t i = size; i-- > 0;)
      value = value << 8U | static_cast<unsigned char>(bytes[at + i]);
    return value;
  };
  const auto refused =
      data_error(path.string() + ": is no .wav of one channel in 16-bit PCM; fetch it again");
  if (bytes.size() < 12 || !bytes.starts_with("RIFF") || bytes.compare(8, 4, "WAVE") != 0)
    return refused;
  Table table{path.string(), {"sound"}, {{}}};
  for (std::size_t at = 12; at + 8 <= bytes.size();) {
    const std::string id = bytes.substr(at, 4);
    const std::size_t size = unsigned_at(at + 4, 4);
    at += 8;
    if (size > bytes.size() - at) return refused;
    if (id == "fmt ") {
      if (size < 16 || unsigned_at(at, 2) != 1 || unsigned_at(at + 2, 2) != 1 ||
          unsigned_at(at + 14, 2) != 16)
        return refused;
      table.rate_hz = unsigned_at(at + 4, 4);
    } else if (id == "data") {
      for (std::size_t i = 0; i + 1 < size; i += 2)
        table.columns[0].push_back(
            static_cast<std::int16_t>(static_cast<std::uint16_t>(unsigned_at(at + i, 2))) /
            32768.0);
    }
    at += size + size % 2;
  }
  if (!(table.rate_hz > 0) || table.rows() == 0) return refused;
  return table;
}

// ---------------------------------------------------------------------------- writing the traces

/// One column of a trace: `scale` times a column of the source.
struct Column {
  Signal signal;
  std::string from;
  double scale = 1;
};

/// A trace about to be written.
struct Output {
  Series t_s;
  std::vector<Signal> signals;
  std::vector<Series> values;
  TraceMetadata metadata;

  void add(Signal signal, Series series) {
    signals.push_back(signal);
    values.push_back(std::move(series));
  }
  Expected<Done> add(const Table& table, const std::vector<Column>& columns) {
    for (const Column& column : columns) {
      auto series = table.column(column.from);
      if (!series) return series.error();
      for (double& value : *series) value *= column.scale;
      add(column.signal, std::move(*series));
    }
    return Done{};
  }
};

/// Rows whose time does not increase are left out and counted: some loggers repeat their last row.
Expected<Done> write(const Output& output, const fs::path& path) {
  const auto ns = [&](std::size_t row) { return nanoseconds_from(output.t_s[row]); };
  std::vector<std::size_t> kept;
  for (std::size_t row = 0; row < output.t_s.size(); ++row)
    if (kept.empty() || ns(row) > ns(kept.back())) kept.push_back(row);
  TraceMetadata metadata = output.metadata;
  if (const std::size_t repeated = output.t_s.size() - kept.size(); repeated > 0)
    metadata.emplace_back("left out",
                          std::to_string(repeated) + " rows whose time does not increase");
  auto writer = TraceWriter::create(path.string(), output.signals, metadata);
  if (!writer) return writer.error();
  std::vector<double> fields(output.signals.size());
  for (const std::size_t row : kept) {
    for (std::size_t i = 0; i < fields.size(); ++i) fields[i] = output.values[i][row];
    if (auto done = writer->write(ns(row), fields); !done) return done.error();
  }
  if (auto done = writer->close(); !done) return done.error();
  std::printf("%s: %zu rows\n", path.string().c_str(), kept.size());
  return Done{};
}

Series row_times(std::size_t rows, double rate_hz) {
  Series t(rows);
  for (std::size_t i = 0; i < rows; ++i) t[i] = static_cast<double>(i) / rate_hz;
  return t;
}

/// Files of `folder` with this extension, sorted by name.
Expected<std::vector<fs::path>> files_in(const fs::path& folder, std::string_view extension) {
  std::vector<fs::path> found;
  std::error_code fault;
  for (fs::directory_iterator i(folder, fault), end; !fault && i != end; i.increment(fault))
    if (i->path().extension() == extension) found.push_back(i->path());
  if (fault)
    return device_error(folder.string() + ": cannot be read; give the folder that holds the set");
  if (found.empty())
    return device_error(folder.string() + ": holds no " + std::string(extension) +
                        " file; give the folder that holds the set");
  std::sort(found.begin(), found.end());
  return found;
}

// ------------------------------------------------------------------------------------- the sets

using enum Quantity;
constexpr Channel kSpindle = Channel::spindle;
constexpr double kRad_per_deg = kPi / 180;

struct Folders {
  fs::path in, out;
  [[nodiscard]] fs::path trace(const fs::path& source, const std::string& suffix = "") const {
    return out / (source.stem().string() + suffix + ".csv");
  }
};

/// A ball-screw axis in closed loop. The force at the stage is gtau times the controller output.
Expected<Done> emps(const Folders& folders) {
  constexpr double kGtau_N_per_V = 35.15065188248547;
  const TraceMetadata about = {
      {"source",
       "Janot, Gautier, Brunot 2019, Data Set and Reference Models of EMPS, "
       "nonlinearbenchmark.org"},
      {"licence", "free benchmark, to be cited; no licence stated"},
      {"units", "x.force_N = 35.15065188248547 N/V times the controller output"}};
  auto start = [&](const Table& table) -> Expected<Output> {
    Output output;
    output.metadata = about;
    auto t = table.column("t_s");
    if (!t) return t.error();
    output.t_s = *t;
    if (auto done = output.add(table, {{{Channel::x, position_m}, "qm_m"},
                                       {{Channel::x, command_position_m}, "qg_m"}});
        !done)
      return done.error();
    return output;
  };
  const fs::path train_path = folders.in / "emps_train.csv";
  auto train = read_csv(train_path);
  if (!train) return train.error();
  auto output = start(*train);
  if (!output) return output.error();
  if (auto done = output->add(*train, {{{Channel::x, force_N}, "vir_V", kGtau_N_per_V}}); !done)
    return done.error();
  if (auto done = write(*output, folders.out / "emps_estimation.csv"); !done) return done.error();

  // The pulse was added behind the controller. With it the force is what the motor gave, and
  // nothing is left to see; without it the force is what the controller asked for, and the pulse is
  // a load.
  const fs::path pulses_path = folders.in / "emps_pulses_dev.csv";
  auto pulses = read_csv(pulses_path);
  if (!pulses) return pulses.error();
  auto vir = pulses->column("vir_V");
  auto pulse = pulses->column("pulse");
  if (!vir) return vir.error();
  if (!pulse) return pulse.error();
  for (const bool demand : {false, true}) {
    auto variant = start(*pulses);
    if (!variant) return variant.error();
    Series force(vir->size());
    for (std::size_t i = 0; i < force.size(); ++i)
      force[i] = kGtau_N_per_V * ((*vir)[i] - (demand ? (*pulse)[i] : 0));
    variant->add({Channel::x, force_N}, std::move(force));
    variant->metadata.emplace_back(
        "force", demand ? "the controller's demand: the pulses are a disturbance that helps the "
                          "motor, -175.75 N on x"
                        : "the motor's, pulses included");
    if (auto done =
            write(*variant, folders.out / (demand ? "emps_pulses.csv" : "emps_pulses_motor.csv"));
        !done)
      return done.error();
  }
  return Done{};
}

// A turn-mill in production: currents are unsigned counts of unpublished scale.

constexpr double kBraking_rad_s2 = 55;  // faster than friction alone stops these spindles
constexpr std::size_t kHalfSpan = 25;   // rows of 1 ms, either side
constexpr double kAlike = 1.5;          // the noise of a small current

/// Change of speed per second around each row; NaN beside a gap.
Series acceleration(const Series& t_s, const Series& speed_rad_s) {
  Series a(t_s.size(), kNone);
  for (std::size_t i = kHalfSpan; i + kHalfSpan < a.size(); ++i) {
    const double dt = t_s[i + kHalfSpan] - t_s[i - kHalfSpan];
    if (dt < 1e-3 * (2 * kHalfSpan + 0.5))
      a[i] = (speed_rad_s[i + kHalfSpan] - speed_rad_s[i - kHalfSpan]) / dt;
  }
  return a;
}

/// Sign that the current of a spindle has by its motion: -1 where the speed falls faster than
/// friction alone would make it. The acceleration tells when to within its span; inside that, a
/// current turns where it passes through zero: at the least magnitudes on either side, and of those
/// that are alike at the nearest, because before it the current may have been as small for long.
Series sign_of_current(const Series& magnitude, const Series& speed_rad_s, const Series& a) {
  const std::size_t rows = a.size();
  Series sign(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    const double along = std::copysign(1.0, speed_rad_s[i]);
    sign[i] = a[i] * along < -kBraking_rad_s2 ? -along : along;
  }
  // What turns back within the span is one noisy turn.
  Series turned = sign;
  std::size_t from = 0;
  for (std::size_t i = 1; i <= rows; ++i) {
    if (i < rows && sign[i] == sign[i - 1]) continue;
    if (from > 0 && i - from <= kHalfSpan)
      std::fill(turned.begin() + static_cast<std::ptrdiff_t>(from),
                turned.begin() + static_cast<std::ptrdiff_t>(i), turned[from - 1]);
    from = i;
  }
  sign = turned;
  for (std::size_t i = 1; i < rows; ++i) {
    if (turned[i] == turned[i - 1]) continue;
    const std::size_t first = i > kHalfSpan ? i - kHalfSpan : 1;
    const std::size_t end = std::min(i + kHalfSpan + 1, rows);
    const auto step = [&](std::size_t k) { return magnitude[k - 1] + magnitude[k]; };
    const auto distance = [&](std::size_t k) { return k < i ? i - k : k - i; };
    double least = step(i);
    for (std::size_t k = first; k < end; ++k) least = std::min(least, step(k));
    std::size_t best = end;
    for (std::size_t k = first; k < end; ++k)
      if (step(k) <= kAlike * least && (best == end || distance(k) < distance(best))) best = k;
    for (std::size_t k = best; k < i; ++k) sign[k] = turned[i];
    for (std::size_t k = i; k < best; ++k) sign[k] = turned[i - 1];
  }
  return sign;
}

double median(Series values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The rows farther than 0.2 s from any in which the cut flag is set: what an idling run would
/// show.
Output air_of(const Output& all, const Series& cutting) {
  constexpr std::size_t kMargin = 200;  // rows, 1 ms apart
  std::vector<bool> air(cutting.size(), true);
  for (std::size_t i = 0; i < cutting.size(); ++i) {
    if (cutting[i] == 0) continue;
    const std::size_t from = i > kMargin ? i - kMargin : 0;
    for (std::size_t k = from; k < std::min(i + kMargin + 1, air.size()); ++k) air[k] = false;
  }
  const auto keep = [&](const Series& series) {
    Series kept;
    for (std::size_t i = 0; i < series.size(); ++i)
      if (air[i]) kept.push_back(series[i]);
    return kept;
  };
  Output out = all;
  out.t_s = keep(all.t_s);
  for (Series& column : out.values) column = keep(column);
  out.metadata.push_back({"air", "rows within 0.2 s of a cut, by the cut flag, are left out"});
  return out;
}

/// One spindle of one record; nothing is written for a spindle that never runs.
Expected<Done> turnmill_spindle(const Table& table, const Series& t_s, const std::string& which,
                                const fs::path& path) {
  auto current = table.column("current_" + which);
  auto speed = table.column("speed_" + which);
  auto cutting = table.column("cut_signal");
  auto tool = table.column("tool_no");
  if (!current) return current.error();
  if (!speed) return speed.error();
  if (!cutting) return cutting.error();
  if (!tool) return tool.error();
  for (double& v : *speed) v = rad_s_from_rpm(v);
  const Series a = acceleration(t_s, *speed);
  Series air, steady;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!(std::abs((*speed)[i]) > 50 && std::abs(a[i]) < 5)) continue;
    steady.push_back((*current)[i]);
    if ((*cutting)[i] == 0) air.push_back((*current)[i]);
  }
  if (steady.empty()) {
    std::printf("%s: not written, this spindle does not run\n", path.string().c_str());
    return Done{};
  }
  const bool has_air = air.size() >= 1000;
  const double unit = median(has_air ? air : steady);
  Series ratio(current->size());
  const Series sign = sign_of_current(*current, *speed, a);
  for (std::size_t i = 0; i < ratio.size(); ++i) ratio[i] = (*current)[i] / unit * sign[i];
  Output output;
  output.t_s = t_s;
  output.metadata = {
      {"source", "tvhahn/Tool-Wear-Files, commit 85a70104, " +
                     fs::path(table.file).filename().string() + ", " + which + " spindle"},
      {"licence", "MIT"},
      {"units", std::string("spindle.current_A is no ampere but a ratio: logged count / ") +
                    number_text(unit) + ", the median " +
                    (has_air ? "while the spindle runs in the air at steady speed"
                             : "at steady speed (this record has too little air cutting)")},
      {"sign",
       "logged without one; here along the speed, and against it while the speed falls faster "
       "than friction alone would make it, from one passage through zero to the next"},
      {"machine.nc_block", "tool number"}};
  output.add({kSpindle, speed_rad_s}, std::move(*speed));
  output.add({kSpindle, current_A}, std::move(ratio));
  output.add({Channel::machine, nc_block}, std::move(*tool));
  if (has_air) {
    fs::path air_path = path;
    air_path.replace_filename(path.stem().string() + "_air" + path.extension().string());
    if (auto done = write(air_of(output, *cutting), air_path); !done) return done.error();
  }
  return write(output, path);
}

Expected<Done> turnmill(const Folders& folders) {
  auto files = files_in(folders.in, ".f32");
  if (!files) return files.error();
  for (const fs::path& file : *files) {
    auto table = read_f32(file);
    if (!table) return table.error();
    Series t_s = row_times(table->rows(), 1000);
    // Records cut into segments keep their row number, so that gaps stay gaps.
    if (auto index = table->column("index"); index)
      std::transform(index->begin(), index->end(), t_s.begin(), [](double i) { return i / 1000; });
    for (const std::string which : {"main", "sub"})
      if (auto done = turnmill_spindle(*table, t_s, which, folders.trace(file, "_" + which)); !done)
        return done.error();
  }
  return Done{};
}

/// For sets whose columns only need a name and a scale. `time` names the column of seconds; without
/// it rows are `rate_hz` apart.
struct PlainSet {
  std::string extension;
  std::string time;
  double rate_hz;
  std::vector<Column> columns;
  TraceMetadata metadata;
  std::string skip;    // a file of the set that is no recording
  std::string suffix;  // of the traces
};

Expected<Done> plain(const Folders& folders, const PlainSet& set) {
  auto files = files_in(folders.in, set.extension);
  if (!files) return files.error();
  for (const fs::path& file : *files) {
    if (file.filename() == set.skip) continue;
    auto table = set.extension == ".f32" ? read_f32(file) : read_csv(file);
    if (!table) return table.error();
    Output output;
    output.t_s = row_times(table->rows(), set.rate_hz);
    if (!set.time.empty()) {
      auto t = table->column(set.time);
      if (!t) return t.error();
      output.t_s = *t;
    }
    output.metadata = set.metadata;
    if (auto done = output.add(*table, set.columns); !done) return done.error();
    if (auto done = write(output, folders.trace(file, set.suffix)); !done) return done.error();
  }
  return Done{};
}

Expected<Done> umich(const Folders& folders) {
  PlainSet set{".csv", "", 10, {}, {}, "runs.csv", ""};
  for (const auto& [channel, prefix] :
       {std::pair{Channel::x, "X1_"}, {Channel::y, "Y1_"}, {Channel::z, "Z1_"}}) {
    const std::string p = prefix;
    set.columns.push_back({{channel, velocity_m_s}, p + "ActualVelocity", 1e-3});
    set.columns.push_back({{channel, command_velocity_m_s}, p + "CommandVelocity", 1e-3});
    set.columns.push_back({{channel, displacement_m}, p + "ActualPosition", 1e-3});
    if (channel != Channel::z)  // zero in every run: not recorded
      set.columns.push_back({{channel, current_A}, p + "CurrentFeedback"});
  }
  set.columns.push_back({{kSpindle, speed_rad_s}, "S1_ActualVelocity", kTwoPi});
  set.columns.push_back({{kSpindle, current_A}, "S1_CurrentFeedback"});
  set.columns.push_back({{kSpindle, power_W}, "S1_OutputPower", 1000});
  set.columns.push_back({{Channel::machine, nc_block}, "M1_sequence_number"});
  set.metadata = {
      {"source", "S. Sun, University of Michigan SMART testbed, CNC Mill Tool Wear (Kaggle)"},
      {"licence", "CC0"},
      {"units", "spindle speed read as revolutions per second: 53.3 is 3200 rpm"},
      {"displacement",
       "the position, rounded to 3 digits by the publisher: too coarse to differentiate, "
       "so the drives use the velocity"}};
  return plain(folders, set);
}

Expected<Done> hsm150(const Folders& folders) {
  const TraceMetadata about = {{"source", "malik-robert/HSM150-data, commit 35c3b1be"},
                               {"licence", "none stated: do not pass on"}};
  PlainSet set{".f32", "", 1000, {{{kSpindle, speed_rad_s}, "velocity"}}, about, "", ""};
  // Two efforts, two traces: the torque that was asked for, and the current that was measured.
  PlainSet measured = set;
  set.suffix = "_commanded";
  set.columns.push_back({{kSpindle, torque_Nm}, "torque_in"});
  set.metadata.emplace_back("units", "spindle.torque_Nm is the commanded torque");
  measured.suffix = "_measured";
  measured.columns.push_back({{kSpindle, current_A}, "current"});
  measured.metadata.emplace_back(
      "units", "A; the set's measured torque is 0.0458 Nm/A times this current, so it is left out");
  if (auto done = plain(folders, set); !done) return done.error();
  return plain(folders, measured);
}

Expected<Done> lugre_servo(const Folders& folders) {
  return plain(folders, {".f32",
                         "",
                         1000,
                         {{{kSpindle, angle_rad}, "pos"},
                          {{kSpindle, speed_rad_s}, "vel"},
                          {{kSpindle, torque_Nm}, "torque_cmd"}},
                         {{"source", "TeacherRock/LuGre_Friction, commit e6ae648e"},
                          {"licence", "none stated: do not pass on"},
                          {"units", "torque command, in Nm by the publisher's parameter values"}},
                         "",
                         ""});
}

Expected<Done> lugre_direct(const Folders& folders) {
  return plain(folders, {".csv",
                         "t_s",
                         0,
                         {{{kSpindle, angle_rad}, "pos_deg", kRad_per_deg},
                          {{kSpindle, speed_rad_s}, "vel_deg_s", kRad_per_deg},
                          {{kSpindle, torque_Nm}, "tau_Nm"}},
                         {{"source", "jorgevchin/Friction-Identification, commit d455ff83"},
                          {"licence", "none stated: do not pass on"},
                          {"units", "one robot joint, written as spindle"}},
                         "",
                         ""});
}

/// A record beside a spindle that turns at a constant, published speed.
Output at_speed(const Table& table, double speed_rpm, TraceMetadata about) {
  Output output;
  output.t_s = row_times(table.rows(), table.rate_hz);
  output.metadata = std::move(about);
  output.metadata.emplace_back("speed", number_text(speed_rpm) + " rpm throughout, not measured");
  output.add({kSpindle, speed_rad_s}, Series(table.rows(), rad_s_from_rpm(speed_rpm)));
  return output;
}

/// A microphone. The speed of the chattering cut is published. That of the stable cut is read off
/// its tooth passing frequency, 149.4 Hz, with the six teeth of the other; that of the idle record
/// is unknown and taken as the chattering cut's.
Expected<Done> milling_audio(const Folders& folders) {
  auto files = files_in(folders.in, ".wav");
  if (!files) return files.error();
  for (const fs::path& file : *files) {
    auto table = read_wav(file);
    if (!table) return table.error();
    const bool stable = file.stem().string().starts_with("stable");
    Series sound = std::move(table->columns[0]);
    table->columns[0].resize(sound.size());
    Output output =
        at_speed(*table, stable ? 149.4 * 60 / 6 : 1656,
                 {{"source",
                   "hafeztrimukti29/chatter-detection-using-accoustic-approach-and-once-per-"
                   "revolution-variance, commit 0a40bb75"},
                  {"licence", "none stated: do not pass on"},
                  {"units", "spindle.torque_Nm is the microphone, full scale = 1"}});
    // No column of a trace is a sound; to the chatter monitor it is a torque without inertia.
    output.add({kSpindle, torque_Nm}, std::move(sound));
    if (auto done = write(output, folders.trace(file)); !done) return done.error();
  }
  return Done{};
}

/// Speed in a file name, "..._6900RPM..."; nothing when it names none or a change of speed.
std::optional<double> speed_in(const std::string& name) {
  const std::size_t end = name.find("RPM");
  if (end == name.npos || name.find("RPM", end + 1) != name.npos) return std::nullopt;
  std::size_t begin = end;
  while (begin > 0 && name[begin - 1] >= '0' && name[begin - 1] <= '9') --begin;
  const auto speed = parse_number(std::string_view(name).substr(begin, end - begin));
  return speed.ok() ? std::optional(speed.value) : std::nullopt;
}

/// Accelerations on the table of a mill, in both directions of the plane of the cut.
Expected<Done> hurco(const Folders& folders) {
  auto files = files_in(folders.in, ".f32");
  if (!files) return files.error();
  for (const fs::path& file : *files) {
    const std::string name = file.stem().string();
    const auto speed = speed_in(name);
    if (!speed) {
      std::printf("%s: not written, its speed changes and is not recorded\n", name.c_str());
      continue;
    }
    auto table = read_f32(file);
    if (!table) return table.error();
    Output output =
        at_speed(*table, *speed,
                 {{"source", "Yang51st/Machining-Chatter-Detection-Program, commit f850dc5a"},
                  {"licence", "none stated: do not pass on"}});
    for (const auto& [axis, quantity] :
         {std::pair{"ax", acceleration_x_m_s2}, std::pair{"ay", acceleration_y_m_s2}}) {
      auto signal = table->column(axis);
      if (!signal) return signal.error();
      output.add({Channel::tool, quantity}, std::move(*signal));
    }
    if (auto done = write(output, folders.trace(file)); !done) return done.error();
  }
  return Done{};
}

/// The currents as they are. Neither rate nor speed is published: all records have a line at a
/// fifth and one at a fifteenth of the rate, which would be three teeth and the rotation at 2000
/// rpm if the rate were 500 Hz. The machine file has that speed, and the current of x stand for the
/// torque.
Expected<Done> tool_edge(const Folders& folders) {
  return plain(
      folders,
      {".f32",
       "",
       500,
       {{{Channel::x, current_A}, "current_x"},
        {{Channel::y, current_A}, "current_y"},
        {{kSpindle, current_A}, "current_s"}},
       {{"source", "yylixianji/current-based-tool-wear-detection-with-FSL-and-TL, commit 2f2ee101"},
        {"licence", "none stated: do not pass on"},
        {"units", "A by size; not published"},
        {"sample rate", "not published; 500 Hz assumed"},
        {"motion", "not recorded: no drive can be estimated from this trace"}},
       "",
       ""});
}

Expected<Done> saw(const Folders& folders) {
  return plain(
      folders,
      {".csv",
       "t_s",
       0,
       {{{Channel::x, position_m}, "head_pos_mm", 1e-3},
        {{Channel::x, velocity_m_s}, "head_vel", 1e-3},
        {{Channel::x, current_A}, "head_torque_pct", 1e-2},
        {{kSpindle, current_A}, "inverter_current"},
        {{kSpindle, power_W}, "active_power_W"}},
       {{"source", "gozerodi/saw-cutting-chatter-detection-xai, commit 56143171"},
        {"licence", "none stated: do not pass on"},
        {"units",
         "x.current_A is no ampere but a ratio: servo torque / rated torque; head velocity "
         "read as mm/s, which is what the position does"}},
       "",
       ""});
}

/// `series` of the times `t_s` at the times `at_s`, on the straight line between its neighbours.
Series interpolated(const Series& t_s, const Series& series, const Series& at_s) {
  Series out;
  out.reserve(at_s.size());
  std::size_t i = 0;
  for (const double at : at_s) {
    while (i + 2 < t_s.size() && t_s[i + 1] <= at) ++i;
    const double part = std::clamp((at - t_s[i]) / (t_s[i + 1] - t_s[i]), 0.0, 1.0);
    out.push_back(series[i] + part * (series[i + 1] - series[i]));
  }
  return out;
}

/// Three joints a trace, as axes x, y, z of which 1 m is 1 rad. The collision monitor wants 500 Hz
/// and more: the 100 Hz of the set, with gaps of 12 ms, are drawn out to an even 1 kHz.
Expected<Done> ur10e_axes(const Folders& folders) {
  auto files = files_in(folders.in, ".f32");
  if (!files) return files.error();
  for (const fs::path& file : *files) {
    auto table = read_f32(file);
    if (!table) return table.error();
    auto t = table->column("t_s");
    if (!t) return t.error();
    if (table->rows() < 2) return data_error(table->file + ": holds one row only");
    const Series even = row_times(static_cast<std::size_t>(t->back() * 1000) + 1, 1000);
    for (const int first : {1, 4}) {
      Output output;
      output.t_s = even;
      output.metadata = {
          {"source", "Innopolis University, shamilmamedov/dynamic_calibration, commit 11af40e7"},
          {"licence", "none stated: do not pass on"},
          {"units", "joints " + std::to_string(first) + " to " + std::to_string(first + 2) +
                        " written as x, y, z: 1 m is 1 rad"},
          {"time", "interpolated from about 100 Hz to 1 kHz"}};
      int joint = first;
      for (const Channel channel : {Channel::x, Channel::y, Channel::z}) {
        const std::string j = std::to_string(joint++);
        for (const auto& [quantity, from] :
             {std::pair{position_m, "q_rad_"}, {current_A, "i_A_"}}) {
          auto series = table->column(from + j);
          if (!series) return series.error();
          output.add({channel, quantity}, interpolated(*t, *series, even));
        }
      }
      if (auto done = write(output, folders.trace(file, "_axes" + std::to_string(first) + "to" +
                                                            std::to_string(first + 2)));
          !done)
        return done.error();
    }
  }
  return Done{};
}

/// One trace a joint. The joint stands as spindle, so that every command takes it.
Expected<Done> ur10e(const Folders& folders) {
  for (int joint = 1; joint <= 6; ++joint) {
    const std::string j = std::to_string(joint);
    auto done = plain(
        folders,
        {".f32",
         "t_s",
         0,
         {{{kSpindle, angle_rad}, "q_rad_" + j},
          {{kSpindle, speed_rad_s}, "qd_rad_s_" + j},
          {{kSpindle, current_A}, "i_A_" + j},
          {{kSpindle, torque_Nm}, "taudes_Nm_" + j}},
         {{"source", "Innopolis University, shamilmamedov/dynamic_calibration, commit 11af40e7"},
          {"licence", "none stated: do not pass on"},
          {"units", "joint " + j +
                        ", written as spindle; spindle.torque_Nm is the "
                        "desired torque"}},
         "",
         "_joint" + j});
    if (!done) return done.error();
  }
  return ur10e_axes(folders);
}

/// Each mean over one second as one pass of the tool, so that the wear monitor takes it: a second
/// at feed with the mean, between 0.3 s in the air and the way back. In the air the drives read
/// zero, since the set does not hold what they read there.
Output passes(const Series& thrust, const Series& torque) {
  constexpr double kRate_hz = 100;
  constexpr double kFeed_m_s = 0.01;
  constexpr double kSpeed_rad_s = 100;
  Output output;
  Series velocity, z, spindle;
  const auto move = [&](double seconds, double speed, double force, double turning) {
    const auto n = static_cast<std::size_t>(std::lround(seconds * kRate_hz));
    velocity.insert(velocity.end(), n, speed);
    z.insert(z.end(), n, force);
    spindle.insert(spindle.end(), n, turning);
  };
  for (std::size_t row = 0; row < thrust.size(); ++row) {
    move(0.3, kFeed_m_s, 0, 0);
    move(1.0, kFeed_m_s, thrust[row], torque[row]);
    move(0.3, kFeed_m_s, 0, 0);
    move(0.2, -8 * kFeed_m_s, 0, 0);
  }
  output.t_s = row_times(z.size(), kRate_hz);
  output.add({Channel::z, velocity_m_s}, std::move(velocity));
  output.add({Channel::z, force_N}, std::move(z));
  output.add({kSpindle, speed_rad_s}, Series(output.t_s.size(), kSpeed_rad_s));
  output.add({kSpindle, torque_Nm}, std::move(spindle));
  return output;
}

/// Means over one second, a trace a tool.
Expected<Done> turning(const Folders& folders) {
  auto table = read_csv(folders.in / "segments_1s.csv");
  if (!table) return table.error();
  auto tool = table->column("tool");
  if (!tool) return tool.error();
  Series tools = *tool;
  std::sort(tools.begin(), tools.end());
  tools.erase(std::unique(tools.begin(), tools.end()), tools.end());
  for (const double wanted : tools) {
    Table part{table->file, table->names, std::vector<Series>(table->columns.size())};
    for (std::size_t row = 0; row < table->rows(); ++row)
      if ((*tool)[row] == wanted)
        for (std::size_t i = 0; i < part.columns.size(); ++i)
          part.columns[i].push_back(table->columns[i][row]);
    Output output;
    output.t_s = row_times(part.rows(), 1);
    output.metadata = {
        {"source",
         "Vicomtech/dataset-machine-tool-wear, commit fa794110; data by Mondragon Unibertsitatea"},
        {"licence", "CC BY-SA 4.0, which this trace keeps"},
        {"units",
         "not published; forces read like N, the spindle torque like Nm, its power like W"},
        {"time",
         "number of the segment; each row is the mean over one second, not always the next one"},
        {"dyno", "x radial force F_p, y cutting force F_c, z feed force F_f"},
        {"motion", "spindle and feed speed are in raw units that are not published: left out"}};
    if (auto done = output.add(part, {{{kSpindle, torque_Nm}, "TV2.S_MEAN"},
                                      {{kSpindle, current_A}, "CV3.S_MEAN"},
                                      {{kSpindle, power_W}, "TV51.S_MEAN"},
                                      {{Channel::x, current_A}, "CV3.X_MEAN"},
                                      {{Channel::z, current_A}, "CV3.Z_MEAN"},
                                      {{Channel::dyno, force_x_N}, "F_p_MEAN"},
                                      {{Channel::dyno, force_y_N}, "F_c_MEAN"},
                                      {{Channel::dyno, force_z_N}, "F_f_MEAN"}});
        !done)
      return done.error();
    const std::string name = "tool_" + number_text(wanted);
    if (auto done = write(output, folders.out / (name + ".csv")); !done) return done.error();
    for (const auto& [kind, thrust_from, torque_from] :
         {std::array{"drives", "TV2.Z_MEAN", "TV2.S_MEAN"},
          std::array{"dyno", "F_f_MEAN", "F_c_MEAN"}}) {
      auto thrust = part.column(thrust_from);
      auto torque = part.column(torque_from);
      if (!thrust) return thrust.error();
      if (!torque) return torque.error();
      Output pass = passes(*thrust, *torque);
      pass.metadata = {output.metadata[0],
                       output.metadata[1],
                       {"units", "z.force_N is " + std::string(thrust_from) +
                                     ", spindle.torque_Nm " + torque_from +
                                     ", as published; motion and time are made up: each mean over "
                                     "one second is a pass of 10 mm"}};
      if (auto done = write(pass, folders.out / (name + "_" + kind + ".csv")); !done)
        return done.error();
    }
  }
  return Done{};
}

struct Set {
  std::string_view name;
  Expected<Done> (*convert)(const Folders&);
};
constexpr Set kSets[] = {{"emps", emps},
                         {"turnmill-production", turnmill},
                         {"umich-cnc-mill", umich},
                         {"turning-torque-force", turning},
                         {"servo-torque-hsm150", hsm150},
                         {"lugre-servo-motor", lugre_servo},
                         {"lugre-direct-drive", lugre_direct},
                         {"milling-chatter-audio", milling_audio},
                         {"mill-vibration-hurco", hurco},
                         {"tool-edge-damage-currents", tool_edge},
                         {"saw-chatter-servo", saw},
                         {"ur10e-friction-collision", ur10e}};

/// Exit status as the servosense program has it.
int complain(const Error& error) {
  std::fprintf(stderr, "%s\n", error.sentence.c_str());
  return error.kind == ErrorKind::usage ? 2 : error.kind == ErrorKind::data ? 3 : 4;
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string_view> names;
  for (const Set& set : kSets) names.push_back(set.name);
  if (argc != 4) {
    std::fprintf(stderr, "usage: recorded_data <set> <source folder> <out folder>\nsets:");
    for (const std::string_view name : names)
      std::fprintf(stderr, " %.*s", static_cast<int>(name.size()), name.data());
    std::fprintf(stderr, "\n");
    return 2;
  }
  const auto set = std::find(names.begin(), names.end(), std::string_view(argv[1]));
  if (set == names.end())
    return complain(usage_error("unknown set " + in_quotes(argv[1]) +
                                "; the nearest known one is " +
                                in_quotes(nearest_name(argv[1], names))));
  const Folders folders{argv[2], argv[3]};
  std::error_code fault;
  fs::create_directories(folders.out, fault);
  if (fault)
    return complain(device_error(folders.out.string() +
                                 ": cannot be made; check the path and its permissions"));
  const auto done = kSets[set - names.begin()].convert(folders);
  return done ? 0 : complain(done.error());
}
