#include "simulation_texts.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"

namespace servosense::detail {
namespace {

/// Words of a text, between blanks.
std::vector<std::string_view> words_of(std::string_view text) {
  std::vector<std::string_view> words;
  for (text = trim(text); !text.empty(); text = trim(text)) {
    const std::size_t end = std::min(text.find_first_of(" \t"), text.size());
    words.push_back(text.substr(0, end));
    text.remove_prefix(end);
  }
  return words;
}

/// One part of a workpiece, "hole 0.03 0 0.005". An error is only what was expected.
std::optional<std::string> add_part(std::string_view text, Workpiece& work) {
  const std::vector<std::string_view> words = words_of(text);
  if (words.empty()) return "expected a block, triangle, slot or hole, not nothing";
  std::vector<double> numbers;
  for (std::size_t i = 1; i < words.size(); ++i) {
    const auto number = parse_number(words[i]);
    if (!number.ok()) return "expected a number, not " + in_quotes(words[i]);
    numbers.push_back(number.value);
  }
  const auto count = numbers.size();
  if (words[0] == "block" && count <= 1) {
    if (count == 1) work.length_m = numbers[0];
  } else if (words[0] == "triangle" && (count == 2 || count == 3)) {
    work.front_depth_m = numbers[0];
    work.far_depth_m = numbers[1];
    if (count == 3) work.length_m = numbers[2];
  } else if (words[0] == "slot" && count == 2) {
    work.slots.push_back({numbers[0], numbers[1]});
  } else if (words[0] == "hole" && count == 3) {
    work.holes.push_back({numbers[0], numbers[1], numbers[2]});
  } else {
    return "expected 'block [LENGTH]', 'triangle FRONT_DEPTH FAR_DEPTH [LENGTH]', 'slot FROM TO' "
           "or 'hole X Y RADIUS', not " +
           in_quotes(trim(text));
  }
  return std::nullopt;
}

bool names_a_part(std::string_view text) {
  const std::vector<std::string_view> words = words_of(text);
  constexpr std::array<std::string_view, 4> kParts = {"block", "triangle", "slot", "hole"};
  return !words.empty() && std::find(kParts.begin(), kParts.end(), words[0]) != kParts.end();
}

Expected<Workpiece> read_workpiece(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  LineReader reader(std::move(*stream), path);
  Workpiece work;
  for (std::string_view line;;) {
    auto more = reader.next(line);
    if (!more) return more.error();
    if (!*more) return work;
    line = trim(line.substr(0, std::min(line.find('#'), line.size())));
    if (line.empty()) continue;
    if (const auto wrong = add_part(line, work)) return reader.error_here(*wrong);
  }
}

/// `RATE %/s [of RPM] [from RPM] [to RPM]`
Expected<SpindleSpeedProfile> ramp_of(const MachineFile& machine, std::string_view text,
                                      double cut_rpm, double duration_s) {
  const auto wrong = [&](const std::string& what) {
    return wrong_at(machine, "simulation", "spindle_speed_profile",
                    "spindle_speed_profile: expected 'RATE %/s [of RPM] [from RPM] [to RPM]' or a "
                    "trace with spindle.speed_rad_s; " +
                        what);
  };
  // "%/s" may touch the number.
  std::string spaced(text);
  if (const std::size_t at = spaced.find("%/s"); at != std::string::npos) spaced.insert(at, " ");
  const std::vector<std::string_view> words = words_of(spaced);
  if (words.size() < 2 || words.size() % 2 != 0 || words[1] != "%/s")
    return wrong(in_quotes(text) + " is neither");
  const auto rate = parse_number(words[0]);
  if (!rate.ok() || rate.value == 0)
    return wrong("the rate " + in_quotes(words[0]) + " is no number other than zero");
  double base = cut_rpm, from = cut_rpm;
  std::optional<double> to;
  for (std::size_t i = 2; i < words.size(); i += 2) {
    const auto rpm = parse_number(words[i + 1]);
    if (!rpm.ok() || !(rpm.value > 0))
      return wrong(in_quotes(words[i + 1]) + " is no positive speed");
    if (words[i] == "of")
      base = rpm.value;
    else if (words[i] == "from")
      from = rpm.value;
    else if (words[i] == "to")
      to = rpm.value;
    else
      return wrong(in_quotes(words[i]) + " is none of: of, from, to");
  }
  // A ramp without an end lasts for the simulation, but never comes to a stop.
  const double end =
      to.value_or(std::max(from + rate.value / 100 * base * duration_s, 0.01 * from));
  if ((end - from) * rate.value < 0)
    return wrong("the ramp leads away from " + number_text(end) + " rpm; change its sign");
  return SpindleSpeedProfile::ramp(from, end, std::abs(rate.value), base);
}

}  // namespace

Error wrong_at(const MachineFile& machine, std::string_view section, std::string_view key,
               const std::string& what) {
  return data_error(machine.where(section, key) + ": " + what);
}

Expected<Workpiece> workpiece_of(const MachineFile& machine, double travel_m) {
  Workpiece work;
  const auto text = machine.text("simulation", "workpiece");
  if (!text) return work;
  if (names_a_part(*text)) {
    std::string_view rest = *text;
    for (std::size_t comma = 0; comma != std::string_view::npos;) {
      comma = rest.find(',');
      if (const auto wrong = add_part(rest.substr(0, comma), work))
        return wrong_at(machine, "simulation", "workpiece", "workpiece: " + *wrong);
      if (comma != std::string_view::npos) rest.remove_prefix(comma + 1);
    }
  } else {
    auto read = read_workpiece(machine.beside(*text));
    if (!read) return read.error();
    work = std::move(*read);
  }
  if (work.is_wedge() && !std::isfinite(work.length_m)) work.length_m = travel_m;
  return work;
}

Expected<SpindleSpeedProfile> speed_profile(const MachineFile& machine, double cut_rpm,
                                            double duration_s) {
  const auto text = machine.text("simulation", "spindle_speed_profile");
  if (!text) return SpindleSpeedProfile{};
  if (text->find("%/s") != std::string::npos) return ramp_of(machine, *text, cut_rpm, duration_s);
  const std::string path = machine.beside(*text);
  auto trace = read_trace(path);
  if (!trace) return trace.error();
  const std::vector<double>* speed = trace->find({Channel::spindle, Quantity::speed_rad_s});
  if (speed == nullptr)
    return data_error(path + ": a spindle speed profile needs the column spindle.speed_rad_s");
  SpindleSpeedProfile profile;
  for (std::size_t i = 0; i < trace->size(); ++i)
    profile.points.push_back({trace->t_s[i], rpm_from_rad_s((*speed)[i])});
  return profile;
}

}  // namespace servosense::detail
