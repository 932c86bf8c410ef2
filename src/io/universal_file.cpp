#include "universal_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/unit_name.hpp"

namespace servosense {
namespace {

// Numbers of the format (SDRC, Universal File Datasets, 58 and 164).
constexpr int kFrequencyResponse = 4, kCoherence = 6;
constexpr int kRealSingle = 2, kRealDouble = 4, kComplexSingle = 5, kComplexDouble = 6;
constexpr int kFrequency = 18, kReactionForce = 9, kExcitationForce = 13;
constexpr int kDisplacement = 8, kVelocity = 11, kAcceleration = 12;
constexpr std::size_t kMostValues = std::size_t{1} << 24U;  // of a dataset: more is no hammer test

/// Factors from the file's units to SI are one over these.
struct UniversalUnits {
  double length = 1, force = 1;
  bool given = false;
};

/// A function of one dataset, in the file's units.
struct UniversalFunction {
  int type = 0;  // kFrequencyResponse, kCoherence or what else there is
  std::vector<double> abscissa;
  std::vector<std::complex<double>> values;
  int numerator = 0, denominator = 0;
  std::string numerator_unit, denominator_unit;
  double exponential_window_per_s = 0;
};

/// The next line, which has to be there.
Expected<std::string> line_of(LineReader& lines, const char* what) {
  std::string_view line;
  auto more = lines.next(line);
  if (!more) return more.error();
  if (!*more)
    return lines.error_here(std::string("the universal file ends within a dataset, ") + what +
                            " was expected; export it again");
  return std::string(line);
}

std::vector<std::string_view> between_blanks(std::string_view line) {
  std::vector<std::string_view> words;
  for (line = trim(line); !line.empty(); line = trim(line)) {
    const std::size_t end = std::min(line.find_first_of(" \t"), line.size());
    words.push_back(line.substr(0, end));
    line.remove_prefix(end);
  }
  return words;
}

/// A number of FORTRAN, whose exponent may be spelled D.
std::optional<double> fortran_number(std::string_view text) {
  std::string plain(text);
  for (char& c : plain)
    if (c == 'D' || c == 'd') c = 'e';
  const auto number = parse_number(plain);
  return number.ok() ? std::optional(number.value) : std::nullopt;
}

std::string_view columns_of(std::string_view line, std::size_t from, std::size_t count) {
  return from < line.size() ? trim(line.substr(from, count)) : std::string_view{};
}

Expected<int> small_number(const LineReader& lines, std::string_view text, const char* what) {
  const auto number = parse_counts(text);
  if (!number.ok() || number.value < -1 || number.value > 100000)
    return lines.error_here(std::string("expected ") + what + ", not " + in_quotes(text));
  return static_cast<int>(number.value);
}

struct OrdinateAxis {
  int kind = 0;
  std::string unit;
};

/// Record 8, 9 or 10: what an axis measures, and its unit.
Expected<OrdinateAxis> axis_of(LineReader& lines, const char* what) {
  auto line = line_of(lines, what);
  if (!line) return line.error();
  auto kind = small_number(lines, columns_of(*line, 0, 10), what);
  if (!kind) return kind.error();
  std::string unit(columns_of(*line, 47, 20));
  if (unit == "NONE" || unit == "none") unit.clear();
  return OrdinateAxis{*kind, unit};
}

/// Record 12, up to the line that ends the dataset.
Expected<Done> take_values(LineReader& lines, UniversalFunction& f, std::size_t count, bool complex,
                           std::optional<std::pair<double, double>> even) {
  const std::size_t each = (even ? 0U : 1U) + (complex ? 2U : 1U);
  std::vector<double> part;
  for (;;) {
    auto line = line_of(lines, "its values or the line -1 at its end");
    if (!line) return line.error();
    const auto words = between_blanks(*line);
    if (words.size() == 1 && words[0] == "-1" && f.values.size() == count && part.empty())
      return Done{};
    for (const std::string_view word : words) {
      const auto number = fortran_number(word);
      if (!number || f.values.size() == count)
        return lines.error_here("expected " + std::to_string(count) +
                                " values and then the line -1, not " + in_quotes(word));
      part.push_back(*number);
      if (part.size() < each) continue;
      const double x = even ? even->first + even->second * static_cast<double>(f.values.size())
                            : part.front();
      if (!(x >= 0) || (!f.abscissa.empty() && !(x > f.abscissa.back())))
        return lines.error_here("frequencies must be positive and rise, but " + printed(x, 6) +
                                " does not");
      f.abscissa.push_back(x);
      f.values.emplace_back(part[each - (complex ? 2U : 1U)], complex ? part.back() : 0.0);
      part.clear();
    }
  }
}

Expected<UniversalFunction> read_function(LineReader& lines) {
  UniversalFunction f;
  FrequencyResponse described;
  for (int i = 0; i < 5; ++i) {
    auto id = line_of(lines, "its five lines of text");
    if (!id) return id.error();
    if (auto ok = take_exponential_window(lines, *id, described); !ok) return ok.error();
  }
  f.exponential_window_per_s = described.exponential_window_per_s;
  auto identification = line_of(lines, "its type of function");
  if (!identification) return identification.error();
  auto type = small_number(lines, columns_of(*identification, 0, 5), "a type of function");
  if (!type) return type.error();
  f.type = *type;
  auto form = line_of(lines, "its form of data");
  if (!form) return form.error();
  const auto words = between_blanks(*form);
  std::array<double, 5> number{};
  bool good = words.size() >= 5;
  for (std::size_t i = 0; good && i < 5; ++i) {
    const auto n = fortran_number(words[i]);
    good = n.has_value();
    number[i] = n.value_or(0);
  }
  const double kind = number[0];
  const bool complex = kind == kComplexSingle || kind == kComplexDouble;
  good = good && (complex || kind == kRealSingle || kind == kRealDouble) && number[1] >= 0 &&
         number[1] <= static_cast<double>(kMostValues) && (number[2] == 0 || number[2] == 1);
  if (!good)
    return lines.error_here(
        "expected a form of data (2, 4, 5 or 6), the number of values, 0 or 1 for their spacing, "
        "the first frequency and the step, not " +
        in_quotes(*form));
  auto abscissa = axis_of(lines, "what its abscissa is");
  if (!abscissa) return abscissa.error();
  const bool wanted = f.type == kFrequencyResponse || f.type == kCoherence;
  if (wanted && abscissa->kind != kFrequency)
    return lines.error_here("expected frequencies (18) as the abscissa, not " +
                            std::to_string(abscissa->kind));
  auto numerator = axis_of(lines, "what its ordinate is");
  if (!numerator) return numerator.error();
  auto denominator = axis_of(lines, "what its ordinate is divided by");
  if (!denominator) return denominator.error();
  f.numerator = numerator->kind, f.numerator_unit = numerator->unit;
  f.denominator = denominator->kind, f.denominator_unit = denominator->unit;
  if (auto z = line_of(lines, "its z axis"); !z) return z.error();
  std::optional<std::pair<double, double>> even;
  if (number[2] == 1) even = {number[3], number[4]};
  if (auto ok = take_values(lines, f, static_cast<std::size_t>(number[1]), complex, even); !ok)
    return ok.error();
  return f;
}

/// Dataset 164: what lengths and forces of the file are divided by to be SI.
Expected<UniversalUnits> read_units(LineReader& lines) {
  UniversalUnits units;
  units.given = true;
  if (auto line = line_of(lines, "the name of its units"); !line) return line.error();
  auto factors = line_of(lines, "the factors of its units");
  if (!factors) return factors.error();
  const auto words = between_blanks(*factors);
  const auto length = words.size() > 1 ? fortran_number(words[0]) : std::nullopt;
  const auto force = words.size() > 1 ? fortran_number(words[1]) : std::nullopt;
  if (!length || !force || !(*length > 0) || !(*force > 0))
    return lines.error_here("expected the factors of length and force, not " + in_quotes(*factors));
  units.length = *length, units.force = *force;
  return units;
}

Expected<Done> skip_dataset(LineReader& lines) {
  for (;;) {
    auto line = line_of(lines, "the line -1 at its end");
    if (!line) return line.error();
    if (trim(*line) == "-1") return Done{};
  }
}

/// One of a unit in SI, if the file has no dataset of its units; an empty unit is SI.
Expected<double> unit_value(const LineReader& lines, const std::string& unit, Dimension dimension) {
  if (unit.empty()) return 1.0;
  const auto known = unit_named(unit, dimension);
  if (!known)
    return data_error(lines.name() + ": the unit " + in_quotes(unit) +
                      " is not known; export in SI units, or with a dataset 164");
  return known->value;
}

Expected<FrequencyResponse> receptance_of(const LineReader& lines, const UniversalFunction& f,
                                          const UniversalUnits& units) {
  const auto not_one = [&](const char* what, int kind) {
    return data_error(lines.name() + ": the " + what + " of the frequency response is of kind " +
                      std::to_string(kind) +
                      "; expected displacement (8), velocity (11) or acceleration (12) over force "
                      "(13 or 9)");
  };
  Dimension dimension = Dimension::length;
  int integrals = 0;
  if (f.numerator == kVelocity)
    dimension = Dimension::velocity, integrals = 1;
  else if (f.numerator == kAcceleration)
    dimension = Dimension::acceleration, integrals = 2;
  else if (f.numerator != kDisplacement)
    return not_one("numerator", f.numerator);
  if (f.denominator != kExcitationForce && f.denominator != kReactionForce)
    return not_one("denominator", f.denominator);
  double scale = units.force / units.length;
  if (!units.given) {
    const auto above = unit_value(lines, f.numerator_unit, dimension);
    if (!above) return above.error();
    const auto below = unit_value(lines, f.denominator_unit, Dimension::force);
    if (!below) return below.error();
    scale = *above / *below;
  }
  FrequencyResponse response;
  response.exponential_window_per_s = f.exponential_window_per_s;
  for (std::size_t i = 0; i < f.abscissa.size(); ++i) {
    if (integrals > 0 && !(f.abscissa[i] > 0)) continue;
    const std::complex<double> s(f.exponential_window_per_s, kTwoPi * f.abscissa[i]);
    std::complex<double> value = scale * f.values[i];
    for (int k = 0; k < integrals; ++k) value /= s;
    if (!std::isfinite(value.real()) || !std::isfinite(value.imag()))
      return data_error(lines.name() + ": the value at " + printed(f.abscissa[i], 6) +
                        " Hz is too large; export it again");
    response.frequency_hz.push_back(f.abscissa[i]);
    response.receptance_m_per_N.push_back(value);
  }
  if (response.frequency_hz.size() < 2)
    return data_error(lines.name() + ": a receptance needs two frequencies or more");
  return response;
}

/// Of the frequencies that the response has.
Expected<std::vector<double>> coherence_of(const LineReader& lines, const UniversalFunction& f,
                                           const FrequencyResponse& response) {
  std::vector<double> coherence;
  for (std::size_t i = 0; i < f.abscissa.size(); ++i) {
    const std::size_t at = coherence.size();
    if (at == response.frequency_hz.size() ||
        std::abs(f.abscissa[i] - response.frequency_hz[at]) >
            1e-6 * response.frequency_hz.back())
      continue;
    if (!(f.values[i].real() >= 0))
      return data_error(lines.name() + ": coherence " + printed(f.values[i].real(), 6) +
                        " is below 0; export it again");
    coherence.push_back(std::min(f.values[i].real(), 1.0));
  }
  if (coherence.size() != response.frequency_hz.size())
    return data_error(lines.name() +
                      ": coherence and frequency response have different frequencies; export them "
                      "together");
  return coherence;
}

/// As FORTRAN reads it from 13 columns, with as many digits as go into 12.
void append_abscissa(std::string& text, double value) {
  char number[40];
  for (int digits = 12; digits > 0; --digits) {
    std::snprintf(number, sizeof number, "%.*g", digits, value);
    if (std::string_view(number).size() <= 12) break;
  }
  char field[40];
  std::snprintf(field, sizeof field, "%13.13s", number);
  text += field;
}

/// Whether frequencies are evenly spaced, as far as the file can tell.
bool evenly_spaced(const std::vector<double>& x) {
  const double step = (x.back() - x.front()) / static_cast<double>(x.size() - 1);
  for (std::size_t i = 0; i < x.size(); ++i)
    if (std::abs(x[i] - x.front() - step * static_cast<double>(i)) > 1e-10 * x.back()) return false;
  return true;
}

void append_axis(std::string& text, int kind, int length_exponent, int force_exponent,
                 const char* label, const char* unit) {
  char line[100];
  std::snprintf(line, sizeof line, "%10d%5d%5d%5d %-20s %-20s\n", kind, length_exponent,
                force_exponent, 0, label, unit);
  text += line;
}

/// One dataset 58; `parts` numbers a value.
void append_function(std::string& text, const FrequencyResponse& response, int type,
                     const std::string& title) {
  const bool complex = type == kFrequencyResponse;
  const std::vector<double>& x = response.frequency_hz;
  const bool even = evenly_spaced(x);
  text += "    -1\n    58\n";
  text += (title.empty() ? "NONE" : title.substr(0, 80)) + "\n";
  if (response.exponential_window_per_s > 0)
    text += std::string(kExponentialWindowKey) + " " +
            number_text(response.exponential_window_per_s) + "\n";
  else
    text += "NONE\n";
  text += "NONE\nNONE\nNONE\n";
  char line[120];
  std::snprintf(line, sizeof line, "%5d%10d%5d%10d %-10s%10d%4d %-10s%10d%4d\n", type, 0, 0, 0,
                "NONE", 1, 0, "NONE", 1, 0);
  text += line;
  std::snprintf(line, sizeof line, "%10d%10zu%10d", complex ? kComplexDouble : kRealDouble,
                x.size(), even ? 1 : 0);
  text += line;
  append_abscissa(text, even ? x.front() : 0);
  append_abscissa(text, even ? (x.back() - x.front()) / static_cast<double>(x.size() - 1) : 0);
  append_abscissa(text, 0);
  text += '\n';
  append_axis(text, kFrequency, 0, 0, "Frequency", "Hz");
  append_axis(text, complex ? kDisplacement : 0, complex ? 1 : 0, 0,
              complex ? "Receptance" : "Coherence", complex ? "m" : "NONE");
  append_axis(text, complex ? kExcitationForce : 0, 0, complex ? 1 : 0, complex ? "Force" : "NONE",
              complex ? "N" : "NONE");
  append_axis(text, 0, 0, 0, "NONE", "NONE");
  // E20.12, four a line where the abscissa is not among them; else a value a line.
  std::size_t in_line = 0;
  const auto more = [&](double value) {
    std::snprintf(line, sizeof line, "%20.12E", value);
    text += line;
    if (even && ++in_line % 4 == 0) text += '\n';
  };
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!even) append_abscissa(text, x[i]);
    more(complex ? response.receptance_m_per_N[i].real() : response.coherence[i]);
    if (complex) more(response.receptance_m_per_N[i].imag());
    if (!even && (complex || i % 2 == 1 || i + 1 == x.size())) text += '\n';
  }
  if (even && in_line % 4 != 0) text += '\n';
  text += "    -1\n";
}

}  // namespace

Expected<FrequencyResponse> read_universal_frf(LineReader& lines) {
  UniversalUnits units;
  std::optional<UniversalFunction> function, coherence;
  for (bool open = true;;) {
    std::string_view line;
    while (!open) {
      auto more = lines.next(line);
      if (!more) return more.error();
      if (!*more) break;
      open = trim(line) == "-1";
      if (!open && !trim(line).empty())
        return lines.error_here("expected the line -1 that begins a dataset, not " +
                                in_quotes(line));
    }
    if (!open) break;
    open = false;
    auto number = line_of(lines, "the number of the dataset");
    if (!number) return number.error();
    const std::string_view dataset = trim(*number);
    if (dataset.starts_with("58b"))
      return lines.error_here("the universal file is binary (58b); export it as ASCII");
    if (dataset == "164") {
      auto read = read_units(lines);
      if (!read) return read.error();
      units = *read;
    }
    if (dataset != "58") {
      if (auto ok = skip_dataset(lines); !ok) return ok.error();
      continue;
    }
    auto read = read_function(lines);
    if (!read) return read.error();
    if (read->type == kFrequencyResponse) {
      if (function)
        return lines.error_here(
            "there is more than one frequency response; export each into a file of its own");
      function = std::move(*read);
    } else if (read->type == kCoherence && !coherence) {
      coherence = std::move(*read);
    }
  }
  if (!function)
    return data_error(lines.name() +
                      ": there is no frequency response (dataset 58 of type 4); export one");
  auto response = receptance_of(lines, *function, units);
  if (!response || !coherence) return response;
  auto shares = coherence_of(lines, *coherence, *response);
  if (!shares) return shares.error();
  response->coherence = std::move(*shares);
  return response;
}

std::string universal_frf_text(const FrequencyResponse& response, const std::string& title) {
  std::string text = "    -1\n   164\n";
  char line[120];
  std::snprintf(line, sizeof line, "%10d%-20s%10d\n", 1, "SI: Meter (newton)", 2);
  text += line;
  std::snprintf(line, sizeof line, "%25.17E%25.17E%25.17E\n%25.17E\n", 1.0, 1.0, 1.0, 273.15);
  text += line;
  text += "    -1\n";
  append_function(text, response, kFrequencyResponse, title);
  if (!response.coherence.empty()) append_function(text, response, kCoherence, title);
  return text;
}

}  // namespace servosense
