// Lines of a measured receptance that no structure can have are left out; sound ones are kept.
#include <cmath>
#include <fstream>
#include <random>
#include <sstream>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/usable_receptance.hpp"
#include "servosense/io/text.hpp"
#include "servosense/model/structural_mode.hpp"

using namespace servosense;

namespace {

// Acceleration with the same noise in every line, integrated twice.
FrequencyResponse measured(const std::vector<StructuralMode>& modes, double noise, double from_hz,
                           unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, noise);
  FrequencyResponse r;
  for (double f = from_hz; f <= 4000; f += 1) {
    const double w = kTwoPi * f;
    std::complex<double> g = 0;
    for (const StructuralMode& m : modes) g += m.receptance(w);
    g += std::complex<double>(normal(random), normal(random)) / (-w * w);
    r.frequency_hz.push_back(f);
    r.receptance_m_per_N.push_back(g);
  }
  return r;
}

const std::vector<StructuralMode> kHeld = {{1074, 0.03, 0.35}, {1961, 0.03, 0.4}};

void noise_of_an_accelerometer() {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    FrequencyResponse r = measured(kHeld, 0.02, 1, seed);
    // And an offset that drifts: it makes the bottom worse, not better.
    for (std::size_t i = 0; i < r.frequency_hz.size(); ++i)
      r.receptance_m_per_N[i] +=
          std::complex<double>(-1, 0.4) * 2e-3 / std::pow(kTwoPi * r.frequency_hz[i], 2);
    const auto usable = usable_receptance(r, "x.csv");
    CHECK(usable);
    if (!usable) continue;
    const double from = usable->table.frequency_hz.front();
    CHECK_BETWEEN(from, 10, 600);
    CHECK(usable->remark.find("lines below") != std::string::npos);
    CHECK_NEAR(usable->table.frequency_hz.back(), 4000, 0);
  }
}

void sound_ones_are_kept() {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const auto all = usable_receptance(measured(kHeld, 1e-9, 1, seed), "x.csv");
    CHECK(all && all->remark.empty() && all->table.frequency_hz.size() == 4000);
    // Begun behind a resonance, where the real part is negative for good reason.
    const auto behind = usable_receptance(measured(kHeld, 1e-6, 1200, seed), "x.csv");
    CHECK(behind && behind->remark.empty());
    // A structure that hangs in springs: a mass line, which dissipates.
    std::vector<StructuralMode> hung = kHeld;
    hung.push_back({3, 0.1, 5});
    const auto mass = usable_receptance(measured(hung, 1e-6, 5, seed), "x.csv");
    CHECK(mass && mass->remark.empty());
  }
}

void low_coherence() {
  FrequencyResponse r = measured(kHeld, 1e-6, 100, 1);
  r.coherence.assign(r.frequency_hz.size(), 0.99);
  for (std::size_t i = 50; i < 60; ++i) r.coherence[i] = 0.5;
  const auto usable = usable_receptance(r, "x.csv");
  CHECK(usable && usable->table.frequency_hz.size() == r.frequency_hz.size() - 10);
  CHECK(usable && usable->remark.find("10 of 3901 lines") != std::string::npos);
  r.coherence.assign(r.frequency_hz.size(), 0.1);
  const auto none = usable_receptance(r, "x.csv");
  CHECK(!none && none.error().sentence.starts_with("x.csv: fewer than 8"));
}

// A hammer test on a milling tool: its publisher calls lines below about 100 Hz unusable.
void recorded_tool() {
  const std::string folder = check::outside_data("nolicence/tool-holder-frf");
  if (folder.empty()) return;
  std::ifstream in(folder + "/frf_point1.csv");
  FrequencyResponse r;
  for (std::string line; std::getline(in, line);) {
    double f = 0, re = 0, im = 0;
    char comma = 0;
    std::istringstream numbers(line);
    if (!(numbers >> f >> comma >> re >> comma >> im) || f <= 0) continue;
    r.frequency_hz.push_back(f);
    r.receptance_m_per_N.emplace_back(re, im);
  }
  CHECK(r.frequency_hz.size() == 5000);
  const auto usable = usable_receptance(r, "frf_point1.csv");
  CHECK(usable);
  if (!usable) return;
  CHECK_BETWEEN(usable->table.frequency_hz.front(), 80, 250);
  std::cout << "  " << usable->remark << '\n';
}

}  // namespace

int main() {
  noise_of_an_accelerometer();
  sound_ones_are_kept();
  low_coherence();
  recorded_tool();
  return check::done();
}
