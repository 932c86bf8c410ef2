#include "servosense/io/watched_cut.hpp"

#include <array>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <sstream>
#include <utility>

#include "json_scanner.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/output_file.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::array<std::string_view, 7> kCutKeys = {
    "spindle_speed_rpm",  "axial_depth_m", "stable", "chatter_hz",
    "radial_immersion_m", "direction",     "note"};

bool read_cut(JsonScanner& json, WatchedCut& cut) {
  const auto positive = [&](const std::string& key, double& value) {
    if (!json.number(value)) return false;
    return value > 0 || json.fail(key + " must be above zero");
  };
  const auto given = [&](const std::string& key, std::optional<double>& value) {
    double number = 0;
    if (!json.number_or_null(number)) return false;
    if (std::isnan(number)) return true;
    value = number;
    return number > 0 || json.fail(key + " must be above zero");
  };
  const bool read = json.object([&](const std::string& key) {
    if (key == "spindle_speed_rpm") return positive(key, cut.spindle_speed_rpm);
    if (key == "axial_depth_m") return positive(key, cut.axial_depth_m);
    if (key == "stable") return json.boolean(cut.stable);
    if (key == "chatter_hz") return given(key, cut.chatter_hz);
    if (key == "radial_immersion_m") return given(key, cut.radial_immersion_m);
    if (key == "note") return json.string(cut.note);
    if (key == "direction") {
      if (!json.string(cut.direction)) return false;
      return cut.direction == "up" || cut.direction == "down" || cut.direction == "slot" ||
             json.fail("direction must be up, down or slot");
    }
    return json.fail("unknown key " + in_quotes(key) + ", the nearest known one is '" +
                     std::string(nearest_name(key, kCutKeys)) + "'");
  });
  if (!read) return false;
  for (const char* key : {"spindle_speed_rpm", "axial_depth_m", "stable"})
    if (!json.seen(key)) return json.fail("the key '" + std::string(key) + "' is missing");
  if (cut.stable && cut.chatter_hz) return json.fail("a stable cut has no chatter_hz");
  return true;
}

}  // namespace

Expected<WatchedCut> watched_cut_from_json(std::string_view line, const std::string& where) {
  WatchedCut cut;
  JsonScanner json(line);
  if (read_cut(json, cut)) return cut;
  return data_error(where + ": " + json.fault +
                    "; give one JSON object a line with spindle_speed_rpm, axial_depth_m, stable");
}

Expected<std::vector<WatchedCut>> read_watched_cuts(const std::string& path) {
  Expected<std::unique_ptr<std::istream>> file = open_for_reading(path);
  if (!file) return file.error();
  return read_watched_cuts(std::move(*file), path);
}

Expected<std::vector<WatchedCut>> read_watched_cuts(std::unique_ptr<std::istream> stream,
                                                    std::string name) {
  LineReader lines(std::move(stream), std::move(name));
  std::vector<WatchedCut> cuts;
  for (;;) {
    std::string_view line;
    const Expected<bool> more = lines.next(line);
    if (!more) return more.error();
    if (!*more) return cuts;
    if (trim(line).empty()) continue;
    Expected<WatchedCut> cut =
        watched_cut_from_json(line, lines.name() + ":" + std::to_string(lines.line_number()));
    if (!cut) return cut.error();
    cuts.push_back(std::move(*cut));
  }
}

std::string to_json_line(const WatchedCut& cut) {
  std::ostringstream out;
  JsonWriter json(out);
  json.begin_object();
  json.member("spindle_speed_rpm", cut.spindle_speed_rpm);
  json.member("axial_depth_m", cut.axial_depth_m);
  json.member("stable", cut.stable);
  if (cut.chatter_hz) json.member("chatter_hz", *cut.chatter_hz);
  if (cut.radial_immersion_m) json.member("radial_immersion_m", *cut.radial_immersion_m);
  if (!cut.direction.empty()) json.member("direction", cut.direction);
  if (!cut.note.empty()) json.member("note", cut.note);
  json.end_object();
  return out.str();
}

Expected<Done> check_watched_cuts(const std::string& path) {
  std::error_code none;
  if (std::filesystem::is_regular_file(path, none))
    if (const auto before = read_watched_cuts(path); !before) return before.error();
  return Done{};
}

Expected<Done> append_watched_cuts(const std::string& path, const std::vector<WatchedCut>& cuts) {
  if (auto done = check_watched_cuts(path); !done) return done.error();
  std::string lines;
  std::error_code none;
  if (std::filesystem::is_regular_file(path, none)) {
    auto file = open_for_reading(path);
    if (!file) return file.error();
    lines.assign(std::istreambuf_iterator<char>(**file), {});
    if (!lines.empty() && lines.back() != '\n') lines += '\n';
  }
  for (const WatchedCut& cut : cuts) lines += to_json_line(cut) + '\n';
  auto out = OutputFile::open(path);
  if (!out) return out.error();
  if (auto done = out->write(lines); !done) return done.error();
  return out->commit();
}

}  // namespace servosense
