#include "case.hpp"

#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace blind {
namespace {

void fail(const std::string& sentence) {
  std::fprintf(stderr, "blind: %s\n", sentence.c_str());
  std::exit(2);
}

void append(std::string& text, double value, int digits) {
  char buffer[40];
  const auto end =
      std::to_chars(buffer, buffer + sizeof buffer, value, std::chars_format::general, digits);
  text.append(buffer, end.ptr);
}

/// A time grid as decimals: whole nanoseconds.
void append_time(std::string& text, double t) {
  char buffer[40];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, t, std::chars_format::fixed, 9);
  text.append(buffer, end.ptr);
}

std::string number(double value) {
  std::string text;
  append(text, value, 9);
  return text;
}

void save(const std::filesystem::path& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  out.write(text.data(), static_cast<std::streamsize>(text.size()));
  if (!out) fail("cannot write " + path.string());
}

std::string trace_text(const Case& c) {
  std::string text;
  const std::size_t rows = c.columns.front().values.size();
  text.reserve(rows * c.columns.size() * 14);
  for (std::size_t i = 0; i < c.columns.size(); ++i)
    text += (i == 0 ? "" : ",") + c.columns[i].name;
  text += '\n';
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t i = 0; i < c.columns.size(); ++i) {
      const double value = c.columns[i].values[row];
      if (i != 0) text += ',';
      if (i == 0)
        append_time(text, value);
      else if (std::isnan(value))
        text += "nan";
      else if (value != kAbsent)
        append(text, value, 12);
    }
    text += '\n';
  }
  return text;
}

}  // namespace

std::vector<std::string> cells() {
  std::vector<std::string> all = drive_cells("drive");
  for (const auto& more : {drive_cells("spindle"), milling_cells(), second_cells("second-drive"),
                           second_cells("second-spindle"), second_milling_cells(),
                           second_cells("book-drive"), second_cells("book-spindle")})
    all.insert(all.end(), more.begin(), more.end());
  return all;
}

Case draw_case(const std::string& name, std::uint64_t seed, const std::string& variant) {
  const auto first = name.find('/');
  if (first == std::string::npos) fail("a case is named domain/cell or domain/cell/effect");
  const std::string domain = name.substr(0, first);
  const auto second = name.find('/', first + 1);
  const std::string cell =
      name.substr(first + 1, second == std::string::npos ? std::string::npos : second - first - 1);
  const std::string effect = second == std::string::npos ? "" : name.substr(second + 1);
  bool known = false;
  for (const std::string& c : cells())
    known = known || (c + "/").starts_with(domain + "/" + cell + "/");
  if (!known) fail("there is no cell '" + name + "'; --list shows all");
  if (domain == "milling") return draw_milling_case(cell, effect, seed, variant);
  if (domain == "second-milling") return draw_second_milling_case(cell, effect, seed, variant);
  if (domain.starts_with("second-") || domain.starts_with("book-"))
    return draw_second_case(domain, cell, effect, seed, variant);
  return draw_drive_case(domain, cell, effect, seed, variant);
}

std::string truth_json(const Case& c) {
  const auto list = [](const std::vector<HiddenEffect>& effects) {
    std::string text;
    for (std::size_t i = 0; i < effects.size(); ++i) {
      const HiddenEffect& e = effects[i];
      text += (i == 0 ? "" : ",\n  ") + std::string("{\"name\": \"") + e.name +
              "\", \"strength\": " + number(e.strength) +
              ", \"visibility\": " + number(e.visibility) + ", \"parameters\": {";
      for (std::size_t j = 0; j < e.parameters.size(); ++j)
        text += (j == 0 ? "\"" : ", \"") + e.parameters[j].first +
                "\": " + number(e.parameters[j].second);
      text += "}}";
    }
    return text;
  };
  std::string text = "{\"case\": \"" + c.name + "\", \"seed\": " + std::to_string(c.seed) +
                     ", \"variant\": \"" + c.variant + "\", \"expect\": \"" + c.truth.expect +
                     "\",\n \"effects\": [" + list(c.truth.effects) + "]";
  if (!c.truth.background.empty()) text += ",\n \"background\": [" + list(c.truth.background) + "]";
  for (const auto& [key, value] : c.truth.circumstances)
    text += (&key == &c.truth.circumstances.front().first ? ",\n \"circumstances\": {\"" : ", \"") +
            key + "\": " + number(value);
  if (!c.truth.circumstances.empty()) text += "}";
  if (!c.truth.note.empty()) text += ",\n \"note\": \"" + c.truth.note + "\"";
  return text + ",\n \"noise_floor\": " + number(c.truth.noise_floor) +
         ", \"gap_before\": " + number(c.truth.gap_before) +
         ", \"gap_oracle\": " + number(c.truth.gap_oracle) +
         ", \"held_out_from_s\": " + number(c.truth.held_out_from_s) + "}\n";
}

void write_case(const Case& c, const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) fail("cannot make " + folder);
  const std::filesystem::path at(folder);
  save(at / "machine.ini", c.machine);
  save(at / "trace.csv", trace_text(c));
  save(at / "truth.json", truth_json(c));
}

}  // namespace blind
