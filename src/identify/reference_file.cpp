// The file: keys, then a table of the sound windows, a row each. What a feature is like in them
// stands above the table for people alone.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <string_view>
#include <utility>

#include "servosense/identify/reference.hpp"
#include "servosense/io/comma_fields.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::string_view kFormat = "servosense reference 1";
constexpr double kMostWindowSamples = 1e8;
constexpr std::size_t kFixedColumns = 6;  // trace, from_s, to_s, load, speed_rad_s, nc_block

std::vector<std::string_view> parts_of(std::string_view text) {
  return trim(text).empty() ? std::vector<std::string_view>{} : comma_fields(text);
}

std::optional<Signal> signal_from(std::string_view name) {
  const std::size_t dot = name.find('.');
  if (dot == std::string_view::npos) return std::nullopt;
  const auto channel = channel_from(name.substr(0, dot));
  const auto quantity = quantity_from(name.substr(dot + 1));
  if (!channel || !quantity) return std::nullopt;
  return Signal{*channel, *quantity};
}

std::string header_of(const ReferenceLayout& layout) {
  std::string header = "trace,from_s,to_s,load,speed_rad_s,nc_block";
  for (const Signal s : layout.place) header += "," + column_name(s);
  for (const ReferenceFeature& f : reference_features(layout)) header += "," + name_of(layout, f);
  return header;
}

/// Reads the keys, each once but `trace`.
class Keys {
 public:
  Expected<Done> add(std::string_view line, const LineReader& lines) {
    const std::size_t equals = line.find('=');
    const std::string key(trim(line.substr(0, equals)));
    const std::string_view value = trim(line.substr(equals + 1));
    if (key == "trace") {
      reference_.traces.emplace_back(value);
      return Done{};
    }
    if (!seen_.insert(key).second)
      return lines.error_here(in_quotes(key) + " stands twice; remove one");
    ReferenceLayout& layout = reference_.layout;
    const auto number = [&](double& to, double low, double high) -> Expected<Done> {
      const auto n = parse_number(value);
      if (!n.ok() || n.value < low || n.value > high)
        return lines.error_here(key + " must be a number of " + number_text(low) + " to " +
                                number_text(high) + ", not " + in_quotes(value));
      to = n.value;
      return Done{};
    };
    if (key == "format") {
      if (value == kFormat) return Done{};
      return lines.error_here("expected the format " + in_quotes(kFormat) + ", not " +
                              in_quotes(value) + "; make the reference anew");
    }
    if (key == "machine") {
      reference_.machine = value;
      return Done{};
    }
    if (key == "tool_diameter_m") return number(reference_.tool_diameter_m, 0, 100);
    if (key == "teeth") {
      double teeth = 0;
      if (auto done = number(teeth, 0, 1000); !done) return done.error();
      layout.teeth = static_cast<unsigned>(teeth);
      if (teeth != std::floor(teeth)) return lines.error_here("teeth must be a whole number");
      return Done{};
    }
    if (key == "false_alarms") return number(reference_.false_alarms, 1e-12, 0.5);
    if (key == "sample_rate_hz") return number(layout.sample_rate_hz, 1e-6, 1e8);
    if (key == "window_s") return number(layout.window_s, 1e-9, 1e9);
    if (key == "speed_rad_s") return number(layout.speed_rad_s, 0, 1e6);
    if (key == "cutting_level") return number(layout.cutting_level, 0, 1e12);
    if (key == "blocks" || key == "speed_measured") {
      if (value != "yes" && value != "no") return lines.error_here(key + " must be yes or no");
      (key == "blocks" ? layout.blocks : layout.speed_measured) = value == "yes";
      return Done{};
    }
    if (key == "effort") {
      effort_ = value;
      return Done{};
    }
    if (key == "signals" || key == "places") {
      std::set<std::string_view> once;
      for (const std::string_view name : parts_of(value)) {
        const auto signal = signal_from(name);
        if (!signal) return lines.error_here(in_quotes(name) + " is no column of a trace");
        if (!once.insert(name).second)
          return lines.error_here(in_quotes(name) + " stands twice; remove one");
        if (key == "signals")
          layout.signals.push_back({*signal, 1});
        else
          layout.place.push_back(*signal);
      }
      return Done{};
    }
    if (key == "scales") {
      for (const std::string_view part : parts_of(value)) {
        const auto n = parse_number(part);
        if (!n.ok() || !(n.value > 0))
          return lines.error_here("scales must be positive numbers, not " + in_quotes(part));
        scales_.push_back(n.value);
      }
      return Done{};
    }
    return lines.error_here("unknown key " + in_quotes(key));
  }

  /// At the header of the table.
  Expected<Reference> finish(const LineReader& lines) {
    for (const char* key : {"format", "machine", "tool_diameter_m", "teeth", "false_alarms",
                            "sample_rate_hz", "window_s", "speed_rad_s", "speed_measured",
                            "cutting_level", "blocks", "effort", "signals", "scales", "places"})
      if (!seen_.contains(key))
        return lines.error_here(std::string("expected the key ") + key + " above the table");
    ReferenceLayout& layout = reference_.layout;
    if (scales_.size() != layout.signals.size())
      return lines.error_here("scales and signals above must be equally many");
    for (std::size_t s = 0; s < scales_.size(); ++s) layout.signals[s].scale = scales_[s];
    const auto effort =
        std::find_if(layout.signals.begin(), layout.signals.end(),
                     [&](const ReferenceSignal& s) { return column_name(s.signal) == effort_; });
    if (effort == layout.signals.end())
      return lines.error_here("the effort above must be one of the signals");
    layout.effort = static_cast<std::size_t>(effort - layout.signals.begin());
    if (layout.window_s * layout.sample_rate_hz > kMostWindowSamples)
      return lines.error_here("window_s above is too long for sample_rate_hz");
    if (reference_.traces.empty())
      return lines.error_here("expected the key trace above the table");
    return reference_;
  }

 private:
  Reference reference_;
  std::set<std::string> seen_;
  std::vector<double> scales_;
  std::string effort_;
};

Expected<SoundWindow> window_of(std::string_view line, std::size_t places, std::size_t features,
                                std::size_t traces, const LineReader& lines) {
  const auto parts = parts_of(line);
  if (parts.size() != kFixedColumns + places + features)
    return lines.error_here("expected " + std::to_string(kFixedColumns + places + features) +
                            " columns, not " + std::to_string(parts.size()));
  std::vector<double> numbers;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (i == 5 && parts[i].empty()) {
      numbers.push_back(-1);
      continue;
    }
    const auto n = parse_number(parts[i]);
    if (!n.ok()) return lines.error_here("expected a number, not " + in_quotes(parts[i]));
    numbers.push_back(n.value);
  }
  const double trace = numbers[0], block = numbers[5];
  if (trace != std::floor(trace) || trace < 1 || trace > static_cast<double>(traces))
    return lines.error_here("trace must be the number of one of the traces above, from 1");
  if (block != std::floor(block) || block < -1 || block > 2147483647.0)
    return lines.error_here("nc_block must be a whole number");
  SoundWindow s;
  s.trace = static_cast<std::size_t>(trace) - 1;
  s.window.from_s = numbers[1];
  s.window.to_s = numbers[2];
  if (!(s.window.to_s > s.window.from_s)) return lines.error_here("to_s must be beyond from_s");
  s.window.load = numbers[3];
  s.window.speed_rad_s = numbers[4];
  s.window.block = static_cast<std::int32_t>(block);
  const auto first = numbers.begin() + kFixedColumns;
  s.window.place.assign(first, first + static_cast<std::ptrdiff_t>(places));
  s.window.values.assign(first + static_cast<std::ptrdiff_t>(places), numbers.end());
  return s;
}

}  // namespace

Expected<Reference> read_reference(LineReader& lines) {
  Keys keys;
  std::optional<Reference> reference;
  std::size_t features = 0;
  for (std::string_view line;;) {
    auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) break;
    line = trim(line);
    if (line.empty() || line.front() == '#') continue;
    if (reference) {
      auto window = window_of(line, reference->layout.place.size(), features,
                              reference->traces.size(), lines);
      if (!window) return window.error();
      if (!reference->sound.empty()) {
        const SoundWindow& before = reference->sound.back();
        if (window->trace < before.trace ||
            (window->trace == before.trace && window->window.from_s < before.window.from_s))
          return lines.error_here("windows must stand in the order of traces and of time");
      }
      reference->sound.push_back(std::move(*window));
      continue;
    }
    if (line.find('=') != std::string_view::npos) {
      if (auto done = keys.add(line, lines); !done) return done.error();
      continue;
    }
    auto known = keys.finish(lines);
    if (!known) return known.error();
    reference = std::move(*known);
    features = reference_features(reference->layout).size();
    if (line != header_of(reference->layout))
      return lines.error_here(
          "the columns are not those that follow from the keys above; make the reference anew");
  }
  if (!reference) return data_error(lines.name() + ": has no table of sound windows");
  return *std::move(reference);
}

Expected<Reference> read_reference(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  LineReader lines(std::move(*stream), path);
  return read_reference(lines);
}

std::string reference_text(const Reference& reference, const std::vector<std::string>& comments) {
  const ReferenceLayout& layout = reference.layout;
  std::string text;
  for (const std::string& comment : comments) text += "# " + comment + "\n";
  const auto key = [&](const char* name, const std::string& value) {
    text += std::string(name) + " = " + value + "\n";
  };
  key("format", std::string(kFormat));
  key("machine", reference.machine);
  key("tool_diameter_m", number_text(reference.tool_diameter_m));
  key("teeth", std::to_string(layout.teeth));
  key("false_alarms", number_text(reference.false_alarms));
  key("sample_rate_hz", number_text(layout.sample_rate_hz));
  key("window_s", number_text(layout.window_s));
  key("speed_rad_s", number_text(layout.speed_rad_s));
  key("speed_measured", layout.speed_measured ? "yes" : "no");
  key("effort", column_name(layout.signals[layout.effort].signal));
  key("cutting_level", number_text(layout.cutting_level));
  std::string signals, scales, places;
  for (const ReferenceSignal& s : layout.signals) {
    signals += (signals.empty() ? "" : ", ") + column_name(s.signal);
    scales += (scales.empty() ? "" : ", ") + number_text(s.scale);
  }
  for (const Signal s : layout.place) places += (places.empty() ? "" : ", ") + column_name(s);
  key("signals", signals);
  key("scales", scales);
  key("places", places);
  key("blocks", layout.blocks ? "yes" : "no");
  for (const std::string& trace : reference.traces) key("trace", trace);
  const auto features = reference_features(layout);
  const auto n = static_cast<double>(reference.sound.size());
  if (!reference.sound.empty())
    text += "# in the sound windows, mean and standard deviation, in the unit of the signal:\n";
  for (std::size_t j = 0; !reference.sound.empty() && j < features.size(); ++j) {
    const bool level = features[j].kind == ReferenceFeatureKind::level;
    const double scale = layout.signals[features[j].signal].scale;
    double sum = 0, square = 0;
    for (const SoundWindow& s : reference.sound) {
      sum += s.window.values[j] / n;
      square += s.window.values[j] * s.window.values[j] / n;
    }
    const double spread = std::sqrt(std::max(0.0, square - sum * sum));
    char line[160];
    if (level)
      std::snprintf(line, sizeof line, "%.4g +- %.2g", scale * sum, scale * spread);
    else
      std::snprintf(line, sizeof line, "%.4g, times or over %.3g", scale * std::exp(sum),
                    std::exp(spread));
    text += "#   " + name_of(layout, features[j]) + ": " + line + "\n";
  }
  text += header_of(layout) + "\n";
  for (const SoundWindow& s : reference.sound) {
    text += std::to_string(s.trace + 1);
    for (const double x : {s.window.from_s, s.window.to_s, s.window.load, s.window.speed_rad_s}) {
      text += ',';
      append_number(text, x);
    }
    text += ',';
    if (s.window.block >= 0) text += std::to_string(s.window.block);
    for (const auto* values : {&s.window.place, &s.window.values})
      for (const double x : *values) {
        text += ',';
        append_number(text, x);
      }
    text += '\n';
  }
  return text;
}

}  // namespace servosense
