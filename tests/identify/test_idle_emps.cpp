// Idle identification on a recorded axis: the estimation record of the EMPS benchmark (Janot,
// Gautier, Brunot 2019) and the parameters its authors published for it.
#include <cmath>
#include <cstdio>

#include "check.hpp"
#include "oracles/emps.hpp"
#include "servosense/identify/idle.hpp"

namespace {

using namespace servosense;

void compare(const char* name, const Estimate& ours, double published, double deviation) {
  std::printf("  %-8s ours %10.4f (%.4f)   published %10.4f (%.4f)   %+.2f of their deviations\n",
              name, ours.value, ours.standard_error, published, deviation,
              (ours.value - published) / deviation);
}

void published_parameters(const std::string& folder) {
  DriveRecord record;
  record.sample_period_s = oracle::kEmpsPeriod_s;
  record.samples = oracle::emps_samples(oracle::read_emps(folder + "/emps_train.csv"));
  CHECK(record.samples.size() == 24841);
  const auto found = identify_idle(oracle::emps_observer(), record);
  CHECK(found.has_value());
  if (!found) {
    std::printf("%s\n", found.error().sentence.c_str());
    return;
  }
  compare("M kg", found->inertia, 95.1089, 0.1085);
  compare("Fv N s/m", found->viscous, 203.5034, 1.1460);
  compare("Fc N", found->coulomb, 20.3935, 0.1012);
  compare("offset N", found->constant_load, -3.1648, 0.0444);
  // Other filters and no decimation: three published standard deviations.
  CHECK_NEAR(found->inertia.value, 95.1089, 3 * 0.1085);
  CHECK_NEAR(found->viscous.value, 203.5034, 3 * 1.1460);
  CHECK_NEAR(found->coulomb.value, 20.3935, 3 * 0.1012);
  CHECK_NEAR(found->constant_load.value, -3.1648, 3 * 0.0444);
  CHECK(found->constant_load_fitted);
  // The published errors assume white residuals and a model that holds. Ours allow for correlated
  // ones, and for friction that is no straight line: this record cruises at one speed only, and its
  // ramps alone give another viscous coefficient, 7 % off.
  CHECK_BETWEEN(found->inertia.standard_error / 0.1085, 0.5, 10.0);
  CHECK_BETWEEN(found->viscous.standard_error / found->viscous.value, 0.02, 0.12);

  check::figure("residual, share of the force (published: 4.08 % at 100 Hz)",
                100 * found->residual_share, "%");
  check::figure("in motion", found->motion_s, "s");
  check::figure("knee", found->friction_knee * 1e6, "um");
  check::figure("noise floor, rms", found->floor.noise_rms, "N");
  check::figure("noise floor, peak", found->floor.noise_peak, "N");
  check::figure("crossings of the mean", found->floor.crossing_rate_hz, "Hz");
  check::figure("smallest step", found->floor.smallest_step, "N");
  // The published model leaves 4.0834 % of the force at a higher bandwidth.
  CHECK_BETWEEN(100 * found->residual_share, 1.0, 4.0834);
  for (const std::string& remark : found->remarks) std::printf("  remark: %s\n", remark.c_str());
}

}  // namespace

int main() {
  const std::string folder = check::outside_data("emps");
  if (!folder.empty()) published_parameters(folder);
  return check::done();
}
