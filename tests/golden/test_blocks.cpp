// Every golden file is what its oracle says, and what its block gives.
//   test_golden blocks --write   writes the files anew
#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "check.hpp"
#include "configs.hpp"
#include "oracles.hpp"
#include "servosense/dsp/moving_average.hpp"
#include "servosense/dsp/moving_fourier.hpp"
#include "servosense/dsp/moving_variance.hpp"
#include "table.hpp"

namespace {

using namespace servosense;
using Row = std::vector<double>;

double wide(float x) { return static_cast<double>(x); }
double wide(double x) { return x; }

// `process` gives the outputs of a row of inputs. Inputs are numbers that float holds, so a block
// in double is held to a thousandth of what float is allowed; its own rounding is 1e-9 of that.
template <typename Real, typename Process>
void compare(const std::string& block, Process&& process) {
  const golden::Table table = golden::read(block);
  const double share = sizeof(Real) == sizeof(double) ? 1e-3 : 1;
  double worst = 0;
  for (std::size_t n = 0; n < table.rows.size(); ++n) {
    const Row& row = table.rows[n];
    std::vector<Real> in;
    for (std::size_t i = 0; i < table.inputs(); ++i) in.push_back(static_cast<Real>(row[i]));
    const std::vector<Real> out = process(in);
    for (std::size_t i = 0; i < table.tolerances.size(); ++i) {
      const double off = std::abs(wide(out.at(i)) - row[table.inputs() + i]);
      const double allowed = share * table.tolerances[i];
      if (!(off <= allowed))
        check::fail(__FILE__, __LINE__)
            << golden::path(block) << ", row " << n + 3 << ", " << table.names[table.inputs() + i]
            << ": off by " << off << ", allowed " << allowed << '\n';
      worst = std::max(worst, off / allowed);
    }
  }
  check::figure(block + (share < 1 ? ", double" : ", float") + ": worst of the tolerance", worst);
  CHECK(worst > 0 && worst <= 1);
}

template <typename Real>
void linear_filters() {
  {
    LowPass<Real> tustin, euler;
    tustin.configure(golden::kTustin);
    euler.configure(golden::kEuler);
    compare<Real>("low_pass", [&](const std::vector<Real>& in) {
      return std::vector<Real>{tustin.process(in[0]), euler.process(in[0])};
    });
  }
  {
    PseudoDerivative<Real> tustin, euler;
    tustin.configure(golden::kTustin);
    euler.configure(golden::kEuler);
    compare<Real>("pseudo_derivative", [&](const std::vector<Real>& in) {
      return std::vector<Real>{tustin.process(in[0]), euler.process(in[0])};
    });
  }
  {
    Biquad<Real> block;
    block.configure({0.25, -0.25, 0.5, -2 * golden::kPole * std::cos(golden::kPoleAngle_rad),
                     golden::kPole * golden::kPole});
    compare<Real>("biquad", [&](const std::vector<Real>& in) {
      return std::vector<Real>{block.process(in[0])};
    });
  }
  {
    Notch<Real> block;
    block.configure(golden::kNotch);
    compare<Real>("notch", [&](const std::vector<Real>& in) {
      return std::vector<Real>{block.process(in[0])};
    });
  }
}

template <typename Real>
void windows() {
  {
    MovingAverage<Real, golden::kAverage> block;
    compare<Real>("moving_average", [&](const std::vector<Real>& in) {
      return std::vector<Real>{block.process(in[0])};
    });
  }
  {
    MovingVariance<Real, golden::kWindow> block;
    block.configure({golden::kWindow});
    compare<Real>("moving_variance", [&](const std::vector<Real>& in) {
      block.process(in[0]);
      return std::vector<Real>{block.state().variance, block.state().mean};
    });
  }
  {
    MovingFourier<Real, golden::kWindow, golden::kHarmonics> block;
    block.configure({golden::kWindow, golden::kHarmonics});
    compare<Real>("moving_fourier", [&](const std::vector<Real>& in) {
      block.process(in[0], in[1]);
      return std::vector<Real>{block.cosine_sum(1), block.sine_sum(1), block.cosine_sum(3),
                               block.sine_sum(3)};
    });
  }
  {
    RotationalFilter<Real, golden::kWindow> block;
    block.configure({golden::kWindow, CosineWindow::hann, Rotation::clockwise});
    compare<Real>("rotational_filter", [&](const std::vector<Real>& in) {
      block.process(in[0], in[1], in[2]);
      return std::vector<Real>{block.state().output.x, block.state().output.y,
                               block.state().radius};
    });
  }
}

template <typename Real>
void residuals_and_turns() {
  {
    LatticeAr<Real, 4> block;
    block.configure(golden::kLattice);
    compare<Real>("lattice_ar", [&](const std::vector<Real>& in) {
      return std::vector<Real>{block.process(in[0])};
    });
  }
  {
    MovingThreshold<Real, 10, 2> block;
    block.configure(golden::kThreshold);
    compare<Real>("moving_threshold", [&](const std::vector<Real>& in) {
      return std::vector<Real>{block.process(in[0])};
    });
  }
  {
    AngleSampler<Real> block;
    block.configure(golden::kSampler);
    compare<Real>("angle_sampler", [&](const std::vector<Real>& in) {
      block.process(in[0], in[1], Quality::good);
      const auto& part = block.state().part;
      return std::vector<Real>{static_cast<Real>(part.index), part.mean[0]};
    });
  }
}

template <typename Real>
void observer() {
  DisturbanceObserver<Real> block;
  block.configure(golden::observer());
  compare<Real>("disturbance_observer", [&](const std::vector<Real>& in) {
    DriveSample<Real> sample;
    // As the oracle has it: the increment is the float nearest to so many micrometres.
    sample.increment = static_cast<Real>(static_cast<float>(wide(in[0]) * 1e-6));
    sample.effort = in[1];
    return std::vector<Real>{block.process(sample)};
  });
}

// No file without oracle, none that says something else, none that is long.
void files_are_what_the_oracles_say() {
  std::set<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator("tests/golden"))
    if (entry.path().extension() == ".csv") files.insert(entry.path().stem().string());
  CHECK(files.size() == golden::oracles().size());
  for (const auto& [block, oracle] : golden::oracles()) {
    const golden::Table written = golden::read(block), said = oracle();
    CHECK(written.names == said.names);
    CHECK(written.tolerances == said.tolerances);
    CHECK(written.rows.size() == said.rows.size() && said.rows.size() <= 400);
    double worst = 0;
    for (std::size_t n = 0; n < std::min(written.rows.size(), said.rows.size()); ++n)
      for (std::size_t i = 0; i < written.names.size(); ++i) {
        const double is = written.rows[n].at(i), should = said.rows[n].at(i);
        worst = std::max(worst, std::abs(is - should) / (1 + std::abs(should)));
      }
    CHECK_NEAR(worst, 0, 1e-11);  // 14 digits are written; libraries differ in the last of 16
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "--write")
    for (const auto& [block, oracle] : golden::oracles()) golden::write(block, oracle());
  files_are_what_the_oracles_say();
  linear_filters<float>();
  linear_filters<double>();
  windows<float>();
  windows<double>();
  residuals_and_turns<float>();
  residuals_and_turns<double>();
  observer<float>();
  observer<double>();
  return check::done();
}
