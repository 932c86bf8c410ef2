// Receptance files: what is written reads back, and what is malformed is named.
#include <memory>
#include <random>
#include <sstream>

#include "check.hpp"
#include "malformed.hpp"
#include "servosense/io/frf_file.hpp"

using namespace servosense;

namespace {

Expected<FrequencyResponse> parsed(const std::string& text) {
  LineReader lines(std::make_unique<std::istringstream>(text), "tip.csv");
  return read_frf(lines);
}

const std::string kHeader = "frequency_hz,receptance_re_m_per_N,receptance_im_m_per_N";

void refused(const std::string& text, const std::string& where, const std::string& what) {
  const auto frf = parsed(text);
  CHECK(!frf);
  if (frf) return;
  const std::string& sentence = frf.error().sentence;
  CHECK_TEXT(sentence.substr(0, where.size()), where);
  if (sentence.find(what) == std::string::npos) CHECK_TEXT(sentence, what);
}

void test_round_trip() {
  for (const bool coherence : {false, true}) {
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> any(-1e-6, 1e-6), share(0, 1);
    FrequencyResponse response;
    for (int i = 0; i < 500; ++i) {
      response.frequency_hz.push_back(0.3125 * i);
      response.receptance_m_per_N.emplace_back(any(random), any(random));
      if (coherence) response.coherence.push_back(share(random));
    }
    const auto copy = parsed("# from a hammer\n\n" + frf_text(response));
    CHECK(copy.has_value());
    if (!copy) continue;
    CHECK(copy->frequency_hz == response.frequency_hz);
    CHECK(copy->receptance_m_per_N == response.receptance_m_per_N);
    CHECK(copy->coherence == response.coherence);
  }
}

FrequencyResponse drawn(unsigned seed, double first_hz, double step_hz, bool bent = false) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> any(-1e-6, 1e-6), share(0, 1);
  FrequencyResponse response;
  for (int i = 0; i < 301; ++i) {
    response.frequency_hz.push_back(first_hz + step_hz * i + (bent ? 0.01 * i * i : 0));
    response.receptance_m_per_N.emplace_back(any(random), any(random));
    response.coherence.push_back(share(random));
    response.standard_error_m_per_N.push_back(1e-9 * share(random));
  }
  response.exponential_window_per_s = 12.5;
  return response;
}

// What each format promises to keep.
void test_formats() {
  for (const bool bent : {false, true}) {
    const FrequencyResponse response = drawn(12, 0.3051757812, 0.3051757812, bent);
    const auto csv = parsed(frf_text(response, FrfFormat::csv, "tool 7, x"));
    const auto columns = parsed(frf_text(response, FrfFormat::columns));
    const auto uff = parsed(frf_text(response, FrfFormat::uff58, "tool 7, x"));
    CHECK(csv && columns && uff);
    if (!csv || !columns || !uff) return;
    CHECK(csv->standard_error_m_per_N == response.standard_error_m_per_N);
    CHECK(csv->coherence == response.coherence);
    CHECK(columns->receptance_m_per_N == response.receptance_m_per_N);
    CHECK(columns->coherence.empty());
    for (const auto* read : {&*csv, &*columns, &*uff}) {
      CHECK_NEAR(read->exponential_window_per_s, 12.5, 0);
      CHECK(read->frequency_hz.size() == response.frequency_hz.size());
    }
    for (std::size_t i = 0; i < uff->frequency_hz.size(); ++i) {
      CHECK_NEAR(uff->frequency_hz[i], response.frequency_hz[i],
                 1e-9 * response.frequency_hz.back());
      CHECK_NEAR(std::abs(uff->receptance_m_per_N[i] - response.receptance_m_per_N[i]), 0, 2e-18);
      CHECK_NEAR(uff->coherence[i], response.coherence[i], 1e-12);
    }
  }
  const auto format = [](const char* path, const char* name = "") {
    const auto f = frf_format(path, name);
    return f ? static_cast<int>(*f) : -1;
  };
  CHECK(format("a.csv") == 0 && format("a.TXT") == 1 && format("a.Uff") == 2);
  CHECK(format("a.csv", "uff58") == 2 && format("a.csv", "uff") == -1);
}

/// A dataset 58 as another program writes it: single precision, 13 columns a number.
std::string foreign(int numerator, const std::string& unit, const std::string& data,
                    const std::string& form = "         5         3         1  0.00000E+00  "
                                              "1.00000E+02  0.00000E+00") {
  const auto axis = [](int kind, const std::string& of) {
    std::string line = "         0    0    0    0 NONE                 " + of;
    const std::string number = std::to_string(kind);
    line.replace(10 - number.size(), number.size(), number);
    return line + "\n";
  };
  return "    -1\n    58\nshaker\n\n27-Nov-09\nNONE\nNONE\n"
         "    4         0    0         0       NONE         1   1       NONE         1   1\n" +
         form + "\n" + axis(18, "Hz") + axis(numerator, unit) + axis(13, "N") + axis(0, "NONE") +
         data + "    -1\n";
}

// Accelerance by hand: a = -(2 pi f)^2 x; in g, in mm with its dataset of units, unevenly spaced.
void test_foreign_universal_files() {
  const std::string data =
      "  1.00000E+00  0.00000E+00 -2.00000E+00  4.00000E+00  1.00000E+00  0.00000E+00\n";
  constexpr double kOmega = 2 * 3.14159265358979 * 100;
  const auto plain = parsed(foreign(8, "m", data));
  CHECK(plain && plain->frequency_hz.size() == 3);
  if (plain) CHECK_NEAR(plain->receptance_m_per_N[1].imag(), 4, 0);
  const auto a = parsed(foreign(12, "m/s^2", data));
  CHECK(a && a->frequency_hz.size() == 2);  // nothing is known of a displacement at 0 Hz
  if (a) CHECK_NEAR(a->receptance_m_per_N[0].real(), 2 / (kOmega * kOmega), 1e-15);
  const auto v = parsed(foreign(11, "m/s", data));
  CHECK(v && v->frequency_hz.size() == 2);
  if (v) CHECK_NEAR(v->receptance_m_per_N[0].real(), 4 / kOmega, 1e-12);
  const auto mm = parsed(foreign(8, "mm", data));
  CHECK(mm);
  if (mm) CHECK_NEAR(mm->receptance_m_per_N[1].imag(), 4e-3, 1e-15);
  const std::string units =
      "    -1\n   164\n         9mm, newton                  2\n"
      "  1.00000000000000000D+03  1.00000000000000000D+00  1.00000000000000000D+00\n"
      "  2.73150000000000000D+02\n    -1\n";
  const auto with_units = parsed(units + foreign(8, "whatever", data));
  CHECK(with_units);
  if (with_units) CHECK_NEAR(with_units->receptance_m_per_N[1].imag(), 4e-3, 1e-15);
  const auto uneven = parsed(
      foreign(8, "m",
              "  1.00000E+01  1.00000E+00  0.00000E+00  2.50000E+01 -2.00000E+00  4.00000E+00\n"
              "  3.00000E+01  1.00000E+00  0.00000E+00\n",
              "         5         3         0  0.00000E+00  0.00000E+00  0.00000E+00"));
  CHECK(uneven && uneven->frequency_hz[1] == 25 && uneven->receptance_m_per_N[1].imag() == 4);
  refused(foreign(8, "furlong", data), "tip.csv: ", "dataset 164");
  refused(foreign(13, "N", data), "tip.csv: ", "displacement (8)");
  refused(foreign(8, "m", data) + foreign(8, "m", data), "tip.csv:", "of its own");
  refused("    -1\n    58b     1     2\n", "tip.csv:2: ", "export it as ASCII");
}

void test_by_hand() {
  const auto frf = parsed(kHeader + ",coherence\r\n0, 1e-6, 0, 0.5\r\n2.5,-1e-6,2e-7,1.24\r\n");
  CHECK(frf.has_value());
  if (!frf) return;
  CHECK(frf->frequency_hz.size() == 2);
  CHECK_NEAR(frf->frequency_hz[1], 2.5, 0);
  CHECK_NEAR(frf->receptance_m_per_N[1].imag(), 2e-7, 0);
  CHECK_NEAR(frf->coherence[1], 1, 0);  // no more than everything is coherent
}

void test_malformed() {
  refused("", "tip.csv: ", "two frequencies");
  refused(kHeader + "\n1,2,3\n", "tip.csv: ", "two frequencies");
  malformed::check_all("frf", 16, [](const std::string& path) {
    const auto frf = read_frf(path);
    return frf ? Error{} : frf.error();
  });
  const auto absent = read_frf("tests/data/no_such_receptance.csv");
  CHECK(!absent && absent.error().kind == ErrorKind::device);
}

}  // namespace

int main() {
  test_round_trip();
  test_formats();
  test_foreign_universal_files();
  test_by_hand();
  test_malformed();
  return check::done();
}
