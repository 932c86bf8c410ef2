// Recordings of real machines, brought into trace files.
//
//   recorded_data SET SOURCE_FOLDER OUT_FOLDER
//
// Sets, with what each is and where it comes from, stand in docs/recorded-data.md. The source folder
// holds the set's files as described there: comma separated text, or 32-bit floats (.f32) with a text
// header (.hdr). Numbers are scaled to SI and otherwise left alone; what has no published unit is
// written as a ratio, and the metadata of the trace says so.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"

using namespace servosense;
namespace fs = std::filesystem;

namespace {

/// Columns of numbers under their names.
struct Columns {
  std::map<std::string, std::vector<double>> by_name;
  std::size_t rows = 0;
  [[nodiscard]] const std::vector<double>& at(const std::string& name) const {
    return by_name.at(name);
  }
};

Expected<Columns> read_text(const fs::path& path) {
  std::ifstream in(path);
  if (!in) return device_error(path.string() + ": cannot be read; is this the folder of the set?");
  Columns columns;
  std::vector<std::string> names;
  std::size_t number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    if (line.empty() || line[0] == '#') continue;
    std::stringstream fields(line);
    std::vector<std::string> words;
    for (std::string word; std::getline(fields, word, ',');) words.push_back(word);
    if (names.empty()) {
      names = words;
      continue;
    }
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto value = parse_number(trim(i < words.size() ? words[i] : ""));
      columns.by_name[names[i]].push_back(value.ok() ? value.value : std::nan(""));  // labels: nan
    }
    ++columns.rows;
  }
  if (columns.rows == 0) return data_error(path.string() + ": holds no rows");
  return columns;
}

/// The channel names of the header up to the unit: "speed_main".
Expected<Columns> read_floats(const fs::path& header) {
  std::ifstream in(header);
  if (!in) return device_error(header.string() + ": cannot be read; is this the folder of the set?");
  std::vector<std::string> names;
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with("channel ")) continue;
    const std::size_t begin = line.find(": ") + 2;
    names.push_back(line.substr(begin, line.find(' ', begin) - begin));
  }
  fs::path data = header;
  data.replace_extension(".f32");
  std::ifstream floats(data, std::ios::binary);
  if (!floats || names.empty())
    return device_error(data.string() + ": cannot be read, or its header names no channel");
  Columns columns;
  std::vector<float> row(names.size());
  while (floats.read(reinterpret_cast<char*>(row.data()),
                     static_cast<std::streamsize>(row.size() * sizeof(float)))) {
    for (std::size_t i = 0; i < names.size(); ++i)
      columns.by_name[names[i]].push_back(static_cast<double>(row[i]));
    ++columns.rows;
  }
  return columns;
}

/// One column of the trace, computed from the row's index.
struct Output {
  Signal signal;
  std::function<double(std::size_t)> value;
};

Expected<Done> write(const fs::path& path, const TraceMetadata& metadata, std::size_t rows,
                     const std::function<double(std::size_t)>& time_s,
                     const std::vector<Output>& outputs) {
  std::vector<Signal> signals;
  for (const Output& output : outputs) signals.push_back(output.signal);
  auto writer = TraceWriter::create(path.string(), signals, metadata);
  if (!writer) return writer.error();
  std::vector<double> values(outputs.size());
  Nanoseconds last = -1;
  for (std::size_t i = 0; i < rows; ++i) {
    const Nanoseconds t = nanoseconds_from(time_s(i));
    if (t <= last) continue;  // rows of the same instant carry nothing new
    last = t;
    for (std::size_t c = 0; c < outputs.size(); ++c) values[c] = outputs[c].value(i);
    if (auto done = writer->write(t, values); !done) return done.error();
  }
  std::printf("%s\n", path.string().c_str());
  return writer->close();
}

std::function<double(std::size_t)> scaled(const std::vector<double>& column, double factor) {
  return [&column, factor](std::size_t i) { return factor * column[i]; };
}
/// The same to `decimals`, for readings that have no more.
std::function<double(std::size_t)> scaled(const std::vector<double>& column, double factor,
                                          int decimals) {
  const double unit = std::pow(10.0, decimals);
  return [&column, factor, unit](std::size_t i) {
    return std::round(factor * column[i] * unit) / unit;
  };
}
std::function<double(std::size_t)> every(double period_s) {
  return [period_s](std::size_t i) { return static_cast<double>(i) * period_s; };
}

Expected<std::vector<fs::path>> files(const fs::path& folder, const std::string& ending) {
  std::vector<fs::path> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ending) found.push_back(entry.path());
  if (error || found.empty())
    return device_error(folder.string() + ": holds no " + ending + " files of this set");
  std::sort(found.begin(), found.end());
  return found;
}

// A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019: 1 kHz, force at the
// load = 35.15 N/V times the controller's output, which in the second record contains the known pulse.
Expected<Done> convert_emps(const fs::path& from, const fs::path& to) {
  constexpr double kForcePerVolt = 35.15065188248547;
  const TraceMetadata metadata = {{"source", "EMPS, Janot, Gautier and Brunot 2019"},
                                  {"units", "SI; x.force_N is the motor's force at the load"}};
  for (const bool pulses : {false, true}) {
    auto in = read_text(from / (pulses ? "emps_pulses_dev.csv" : "emps_train.csv"));
    if (!in) return in.error();
    const auto& volt = in->at("vir_V");
    const std::vector<double> none(in->rows, 0.0);
    const auto pulse = std::find_if(in->by_name.begin(), in->by_name.end(),
                                    [](const auto& c) { return c.first.starts_with("pulse"); });
    const std::vector<double>& known = pulse == in->by_name.end() ? none : pulse->second;
    // What the controller alone asked for; the pulse is then a load from outside.
    auto done = write(to / (pulses ? "emps_pulses.csv" : "emps_estimation.csv"), metadata, in->rows,
                      scaled(in->at("t_s"), 1),
                      {{{Channel::x, Quantity::position_m}, scaled(in->at("qm_m"), 1)},
                       {{Channel::x, Quantity::force_N},
                        [&](std::size_t i) { return kForcePerVolt * (volt[i] - known[i]); }},
                       {{Channel::x, Quantity::command_position_m}, scaled(in->at("qg_m"), 1)}});
    if (!done) return done;
  }
  return Done{};
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// github.com/tvhahn/Tool-Wear-Files, MIT: 1 kHz, current without sign and scale.
Expected<Done> convert_turnmill(const fs::path& from, const fs::path& to) {
  auto headers = files(from, ".hdr");
  if (!headers) return headers.error();
  for (const fs::path& header : *headers) {
    auto in = read_floats(header);
    if (!in) return in.error();
    const bool whole = !in->by_name.contains("index");
    for (const std::string spindle : {"main", "sub"}) {
      const auto& current = in->at("current_" + spindle);
      const auto& speed = in->at("speed_" + spindle);
      const auto& cut = in->at("cut_signal");
      // The unit: turning steadily in the air; where the record has no air, turning steadily.
      std::vector<double> steady;
      std::vector<double> steady_air;
      for (std::size_t i = 100; i + 100 < in->rows; ++i) {
        if (speed[i] < 500 || std::abs(speed[i + 100] - speed[i - 100]) > 10) continue;
        steady.push_back(current[i]);
        if (cut[i] == 0) steady_air.push_back(current[i]);
      }
      if (steady.size() < 500) continue;  // this spindle stands still here
      const bool air = steady_air.size() >= 500;
      const double unit = median(air ? steady_air : steady);
      const TraceMetadata metadata = {
          {"source", "github.com/tvhahn/Tool-Wear-Files commit 85a70104 (MIT), " + header.stem().string()},
          {"units", std::string("spindle.current_A is a ratio: 1 = median current of the spindle turning "
                                "steadily") + (air ? " in the air (" : " (") + number_text(unit) + " counts of the control). No scale is published, and the "
                    "current carries no sign, so braking looks like driving."}};
      auto done = write(to / (header.stem().string() + "_" + spindle + ".csv"), metadata, in->rows,
                        whole ? every(1e-3) : scaled(in->at("index"), 1e-3),
                        {{{Channel::spindle, Quantity::speed_rad_s}, scaled(speed, kTwoPi / 60, 4)},
                         {{Channel::spindle, Quantity::current_A}, scaled(current, 1 / unit, 4)}});
      if (!done) return done;
    }
  }
  return Done{};
}

// S. Sun, CNC Mill Tool Wear (Kaggle), CC0: 10 Hz. Positions are rounded to three digits, so the
// velocity columns are the motion.
Expected<Done> convert_umich(const fs::path& from, const fs::path& to) {
  auto runs = files(from, ".csv");
  if (!runs) return runs.error();
  for (const fs::path& run : *runs) {
    if (!run.stem().string().starts_with("experiment")) continue;
    auto in = read_text(run);
    if (!in) return in.error();
    std::vector<Output> outputs;
    const std::pair<Channel, std::string> axes[] = {{Channel::x, "X1"}, {Channel::y, "Y1"}, {Channel::z, "Z1"}};
    for (const auto& [channel, name] : axes) {
      outputs.push_back({{channel, Quantity::velocity_m_s}, scaled(in->at(name + "_ActualVelocity"), 1e-3)});
      outputs.push_back({{channel, Quantity::current_A}, scaled(in->at(name + "_CurrentFeedback"), 1)});
    }
    outputs.push_back({{Channel::spindle, Quantity::speed_rad_s}, scaled(in->at("S1_ActualVelocity"), kTwoPi)});
    outputs.push_back({{Channel::spindle, Quantity::current_A}, scaled(in->at("S1_CurrentFeedback"), 1)});
    auto done = write(to / run.filename(),
                      {{"source", "CNC Mill Tool Wear, University of Michigan SMART testbed (CC0)"},
                       {"units", "axis velocity in m/s; spindle speed read as turns per second (its unit is not published)"}},
                      in->rows, every(0.1), outputs);
    if (!done) return done;
  }
  return Done{};
}

// A rotary servo with angle and torque: github.com/malik-robert/HSM150-data and
// github.com/TeacherRock/LuGre_Friction, no licence stated.
Expected<Done> convert_rotary(const fs::path& from, const fs::path& to, const std::string& angle,
                              const std::string& torque, const std::string& source) {
  auto headers = files(from, ".hdr");
  if (!headers) return headers.error();
  for (const fs::path& header : *headers) {
    auto in = read_floats(header);
    if (!in) return in.error();
    auto done = write(to / (header.stem().string() + ".csv"), {{"source", source}, {"units", "rad, Nm"}},
                      in->rows, every(1e-3),
                      {{{Channel::spindle, Quantity::angle_rad}, scaled(in->at(angle), 1)},
                       {{Channel::spindle, Quantity::torque_Nm}, scaled(in->at(torque), 1)}});
    if (!done) return done;
  }
  return Done{};
}

// github.com/shamilmamedov/dynamic_calibration, no licence stated: six joints, about 100 Hz.
Expected<Done> convert_ur10e(const fs::path& from, const fs::path& to) {
  auto headers = files(from, ".hdr");
  if (!headers) return headers.error();
  for (const fs::path& header : *headers) {
    auto in = read_floats(header);
    if (!in) return in.error();
    for (int joint = 1; joint <= 6; ++joint) {
      const std::string j = std::to_string(joint);
      const auto current = std::find_if(in->by_name.begin(), in->by_name.end(), [&](const auto& c) {
        return c.first == "i_A_" + j || c.first == "I_A_" + j || c.first == "i_" + j;
      });
      if (current == in->by_name.end())
        return data_error(header.string() + ": names no current of joint " + j);
      auto done = write(to / (header.stem().string() + "_joint" + j + ".csv"),
                        {{"source", "UR10e, Innopolis University"}, {"units", "rad, A"}}, in->rows,
                        scaled(in->at("t_s"), 1),
                        {{{Channel::spindle, Quantity::angle_rad}, scaled(in->at("q_rad_" + j), 1)},
                         {{Channel::spindle, Quantity::current_A}, scaled(current->second, 1)}});
      if (!done) return done;
    }
  }
  return Done{};
}

// github.com/gozerodi/saw-cutting-chatter-detection-xai, no licence stated: 10 Hz.
Expected<Done> convert_saw(const fs::path& from, const fs::path& to) {
  auto cuts = files(from, ".csv");
  if (!cuts) return cuts.error();
  for (const fs::path& cut : *cuts) {
    auto in = read_text(cut);
    if (!in) return in.error();
    auto done = write(to / cut.filename(), {{"source", "saw-cutting-chatter-detection-xai"}, {"units", "m, A without sign"}},
                      in->rows, scaled(in->at("t_s"), 1),
                      {{{Channel::x, Quantity::position_m}, scaled(in->at("head_pos_mm"), 1e-3)},
                       {{Channel::x, Quantity::current_A}, scaled(in->at("head_current_abs"), 1)}});
    if (!done) return done;
  }
  return Done{};
}

using Convert = std::function<Expected<Done>(const fs::path&, const fs::path&)>;

const std::map<std::string, Convert>& sets() {
  static const std::map<std::string, Convert> all = {
      {"emps", convert_emps},
      {"turnmill-production", convert_turnmill},
      {"umich-cnc-mill", convert_umich},
      {"servo-torque-hsm150",
       [](const fs::path& from, const fs::path& to) {
         return convert_rotary(from, to, "position", "torque_in", "HSM150 bench, commanded torque");
       }},
      {"lugre-servo-motor",
       [](const fs::path& from, const fs::path& to) {
         return convert_rotary(from, to, "pos", "torque_cmd", "LuGre_Friction, commanded torque");
       }},
      {"ur10e-friction-collision", convert_ur10e},
      {"saw-chatter-servo", convert_saw},
  };
  return all;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 || !sets().contains(argv[1])) {
    std::fprintf(stderr, "usage: recorded_data SET SOURCE_FOLDER OUT_FOLDER\nsets:");
    for (const auto& [name, convert] : sets()) std::fprintf(stderr, " %s", name.c_str());
    std::fprintf(stderr, "\n");
    return 2;
  }
  std::error_code error;
  fs::create_directories(argv[3], error);
  if (auto done = sets().at(argv[1])(argv[2], argv[3]); !done) {
    std::fprintf(stderr, "%s\n", done.error().sentence.c_str());
    return done.error().kind == ErrorKind::device ? 4 : 3;
  }
  return 0;
}
