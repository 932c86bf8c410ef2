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
  malformed::check_all("frf", 9, [](const std::string& path) {
    const auto frf = read_frf(path);
    return frf ? Error{} : frf.error();
  });
  const auto absent = read_frf("tests/data/no_such_receptance.csv");
  CHECK(!absent && absent.error().kind == ErrorKind::device);
}

}  // namespace

int main() {
  test_round_trip();
  test_by_hand();
  test_malformed();
  return check::done();
}
