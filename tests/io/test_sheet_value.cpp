// Figures of data sheets in the units of a machine file. Oracle: values worked out by hand from the
// definitions of the units (inch 25.4 mm, pound 0.45359237 kg, g 9.80665 m/s2).
#include <cmath>
#include <set>
#include <string>

#include "check.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/io/sheet_figures.hpp"
#include "servosense/io/sheet_value.hpp"
#include "servosense/io/text.hpp"

using namespace servosense;

namespace {

struct Read {
  const char* text;
  const char* unit;
  double value;
};

void units_of_data_sheets() {
  const double pi = std::acos(-1.0);
  const Read cases[] = {
      {"10mm", "m", 0.01},
      {"16 um", "m", 1.6e-5},
      {"16 \xC2\xB5m", "m", 1.6e-5},
      {"0.5 in", "m", 0.0127},
      {"12 kg cm2", "kg m2", 1.2e-3},
      {"12 kg\xC2\xB7"
       "cm\xC2\xB2",
       "kg m2", 1.2e-3},
      {"12kgcm2", "kg m2", 1.2e-3},
      {"12 kg*cm^2", "kg m2", 1.2e-3},
      {"350 g cm2", "kg m2", 3.5e-5},
      {"350 gcm2", "kg m2", 3.5e-5},
      {"2 lb in2", "kg m2", 2 * 0.45359237 * 0.0254 * 0.0254},
      {"2 lb-in2", "kg m2", 2 * 0.45359237 * 0.0254 * 0.0254},
      {"1.5 oz-in-s2", "kg m2", 1.5 * 0.45359237 / 16 * 9.80665 * 0.0254},
      {"5 lb", "kg", 2.26796185},
      {"500 g", "kg", 0.5},
      {"45 Ncm", "Nm", 0.45},
      {"1.2 kNm", "Nm", 1200},
      {"100 lb-in", "Nm", 100 * 0.45359237 * 9.80665 * 0.0254},
      {"7 kN", "N", 7000},
      {"11 kW", "W", 11000},
      {"10 hp", "W", 10 * 550 * 0.45359237 * 9.80665 * 0.3048},
      {"6000 rpm", "rad/s", 200 * pi},
      {"6000 1/min", "rad/s", 200 * pi},
      {"6000 min-1", "rpm", 6000},
      {"10 rad/s", "rpm", 300 / pi},
      {"30 m/min", "m/s", 0.5},
      {"50 mm/s", "m/s", 0.05},
      {"8kHz", "Hz", 8000},
      {"8000 1/s", "Hz", 8000},
      {"250us", "s", 2.5e-4},
      {"90 deg", "rad", pi / 2},
      {"90\xC2\xB0", "rad", pi / 2},
      {"0.5 rad", "deg", 90 / pi},
      {"30", "deg", 30},
      {"0.85 Nm/A", "Nm/A", 0.85},
      {"85 Ncm/A", "Nm/A", 0.85},
      {"0.85 Nm/Arms", "Nm/A", 0.85},
      {"0.85 Nm/A rms", "Nm/A", 0.85},
      {"47 V/1000rpm", "V s/rad", 47 * 60 / (2000 * pi)},
      {"47 V/1000 min-1", "V s/rad", 47 * 60 / (2000 * pi)},
      {"47 V per krpm", "V s/rad", 47 * 60 / (2000 * pi)},
      {"47 mV/rpm", "V s/rad", 47 * 60 / (2000 * pi)},
      {"3.5 mNm/krpm", "Nm s/rad", 0.0035 * 60 / (2000 * pi)},
      {"2 Nm/(rad/s)", "Nm s/rad", 2},
      {"20 bit", "counts", 1048576},
      {"5000 lines", "counts", 20000},
      {"5000 lines/rev", "counts", 20000},
      {"20000 counts/rev", "counts", 20000},
      {"20000 cpr", "counts", 20000},
      {"10 mm/rev", "m", 0.01},
      {"0.5 in/rev", "m", 0.0127},
      {"24bit", "bit", 24},
      {"47 mV/(r/min)", "V s/rad", 47 * 60 / (2000 * pi)},
      {"0.2 arcsec", "rad", 0.2 / 3600 * pi / 180},
      {"3 arcmin", "deg", 0.05},
      {"20 %", "", 0.2},
      {"3 inch", "m", 0.0762},
      {"2 ft", "m", 0.6096},
      {"3 lbs", "kg", 3 * 0.45359237},
      {"8 oz", "kg", 4 * 0.45359237 / 8},
      {"2 lbf", "N", 2 * 0.45359237 * 9.80665},
      {"32 ozf", "N", 2 * 0.45359237 * 9.80665},
      {"2 kgf", "N", 19.6133},
      {"3 in-lb", "Nm", 3 * 0.45359237 * 9.80665 * 0.0254},
      {"3 lbf-in", "Nm", 3 * 0.45359237 * 9.80665 * 0.0254},
      {"3 lbf in", "Nm", 3 * 0.45359237 * 9.80665 * 0.0254},
      {"3 lb-ft", "Nm", 3 * 0.45359237 * 9.80665 * 0.3048},
      {"3 ft-lb", "Nm", 3 * 0.45359237 * 9.80665 * 0.3048},
      {"3 lbf-ft", "Nm", 3 * 0.45359237 * 9.80665 * 0.3048},
      {"16 oz-in", "Nm", 0.45359237 * 9.80665 * 0.0254},
      {"5 kgmm2", "kg m2", 5e-6},
      {"5 kgm2", "kg m2", 5},
      {"5 lb-ft2", "kg m2", 5 * 0.45359237 * 0.3048 * 0.3048},
      {"16 oz-in2", "kg m2", 0.45359237 * 0.0254 * 0.0254},
      {"5 lb-in-s2", "kg m2", 5 * 0.45359237 * 9.80665 * 0.0254},
      {"5 lb-ft-s2", "kg m2", 5 * 0.45359237 * 9.80665 * 0.3048},
      {"10 HP", "W", 10 * 550 * 0.45359237 * 9.80665 * 0.3048},
      {"2 PS", "W", 2 * 75 * 9.80665},
      {"0.5 MHz", "Hz", 5e5},
      {"2 krpm", "rpm", 2000},
      {"2 turn", "rad", 4 * pi},
      {"3 Aeff", "A", 3},
      {"3 Apeak", "A", 3},
      {"3 Veff/krpm", "V s/rad", 3 * 60 / (2000 * pi)},
      {"3 Vpk/krpm", "V s/rad", 3 * 60 / (2000 * pi)},
      {"3 Vpeak/krpm", "V s/rad", 3 * 60 / (2000 * pi)},
      {"3 V eff/krpm", "V s/rad", 3 * 60 / (2000 * pi)},
      {"3 A RMS", "A", 3},
      {"3 A pk", "A", 3},
      {"20 bits", "counts", 1048576},
      {"1 line", "counts", 4},
      {"-1.5e-3 m", "m", -1.5e-3},
      {"+3 A", "A", 3},
      {"700 N/mm2", "N/m2", 7e8},
      {"9 N/mm", "N/m", 9000},
      {"1 kW h/h", "W", 1000},
      {"2 (N m)2", "(Nm)2", 2},
      {"5 g", "m/s2", 5 * 9.80665},
  };
  for (const Read& c : cases) {
    const auto read = sheet_value_from(c.text, c.unit, true);
    check::that(read.has_value(), (std::string(c.text) + " in " + c.unit).c_str(), __FILE__,
                __LINE__);
    if (!read) {
      std::cout << "  " << read.error().sentence << '\n';
      continue;
    }
    check::near(read->value, c.value, 1e-12 * std::abs(c.value), c.text, __FILE__, __LINE__);
  }
}

void wrong_units() {
  const Read cases[] = {
      {"10 kg", "m", 0},
      {"10 Nm", "m", 0},
      {"8 Hz", "rad/s", 0},
      {"125 us", "Hz", 0},
      {"0,85 Nm/A", "Nm/A", 0},
      {"1 000 mm", "m", 0},
      {"20 000 counts", "counts", 0},
      {"6 100 rpm", "rpm", 0},
      {"60 bit", "counts", 0},
      {"2.5 bit", "counts", 0},
      {"5 lines", "m", 0},
      {"0x10", "m", 0},
      {"nan", "m", 0},
      {"inf", "m", 0},
      {"1e400", "m", 0},
      {"", "m", 0},
      {"mm", "m", 0},
      {"10 mm mm", "m", 0},
      {"10 mm/", "m", 0},
      {"10 (mm", "m", 0},
      {"10 mm)", "m", 0},
      {"10 */ mm", "m", 0},
      {"3 A", "", 0},
      {"1e300 km2", "m", 0},
      {"3 Arms/Apk", "", 0},
      {"5 m2147483648", "m", 0},
      {"10'000 rpm", "rpm", 0},
      {"3 V/2000 rpm", "V s/rad", 0},
      {"3 m0", "", 0},
      {"5000 pulses", "counts", 0},
      {"5000 ppr", "counts", 0},
  };
  for (const Read& c : cases) {
    const auto read = sheet_value_from(c.text, c.unit, std::string(c.unit) == "counts");
    check::that(!read.has_value(), (std::string(c.text) + " is no " + c.unit).c_str(), __FILE__,
                __LINE__);
  }
  // "10 mm/rev" for what is no value per turn.
  CHECK(!sheet_value_from("10 mm/rev", "m", false).has_value());
  CHECK(!sheet_value_from("20 bit", "counts", false).has_value());
}

void amplitudes() {
  const auto amplitude = [](const char* text, const char* unit) {
    const auto read = sheet_value_from(text, unit);
    CHECK(read.has_value());
    return read ? read->amplitude : Amplitude::unsaid;
  };
  CHECK(amplitude("1 Nm/A", "Nm/A") == Amplitude::unsaid);
  CHECK(amplitude("1 Nm/Arms", "Nm/A") == Amplitude::effective);
  CHECK(amplitude("1 Nm/A(rms)", "Nm/A") == Amplitude::effective);
  CHECK(amplitude("1 Nm/Apk", "Nm/A") == Amplitude::peak);
  CHECK(amplitude("3 A peak", "A") == Amplitude::peak);
  CHECK(amplitude("3 Vrms/krpm", "V s/rad") == Amplitude::effective);
}

/// A number in the unit that the table names is that number.
void every_unit_of_the_table() {
  std::size_t read = 0;
  std::set<std::string> other;
  const auto look = [&](const MachineKey& key) {
    if ((key.kind != KeyKind::number && key.kind != KeyKind::integer &&
         key.kind != KeyKind::list) ||
        key.unit.empty())
      return;
    const auto value = sheet_value_from("3 " + std::string(key.unit), key.unit);
    if (!value) {
      other.insert(std::string(key.unit));
      return;
    }
    ++read;
    CHECK_NEAR(value->value, 3, 0);
  };
  for (const MachineKey& key : machine_keys()) look(key);
  for (const MachineKey& figure : sheet_figures()) look(figure);
  CHECK(read > 120);
  // Symbols of the catalogue of effects, which are no units: bare numbers only.
  for (const std::string& unit : other) {
    check::that(unit.size() <= 3, ("unit of a key: " + unit).c_str(), __FILE__, __LINE__);
    CHECK(sheet_value_from("3", unit).has_value());
  }
}

}  // namespace

int main() {
  units_of_data_sheets();
  wrong_units();
  amplitudes();
  every_unit_of_the_table();
  return check::done();
}
