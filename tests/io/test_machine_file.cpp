// Machine files: every key, every error, and text that survives being read, changed and written.
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <limits>
#include <random>
#include <set>
#include <sstream>

#include "check.hpp"
#include "malformed.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/machine_keys.hpp"

using namespace servosense;

namespace {

std::string file_text(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return std::move(text).str();
}

MachineFile file_of(const std::string& text) {
  Expected<MachineFile> file = MachineFile::parse(text, "memory");
  CHECK(file.has_value());
  if (!file) std::cout << "    " << file.error().sentence << '\n';
  return file ? *file : *MachineFile::parse("", "empty");
}

/// Written by hand from the published list of sections and keys, not from the table.
void test_every_key() {
  const std::string path = "tests/data/machine/complete.ini";
  const Expected<MachineFile> file = MachineFile::read(path);
  CHECK(file.has_value());
  if (!file) {
    std::cout << "    " << file.error().sentence << '\n';
    return;
  }
  CHECK_TEXT(file->text(), file_text(path));
  CHECK_TEXT(file->text("machine", "name").value_or(""), "bench mill 3");
  CHECK(file->number("machine", "sample_rate_hz") == 8000);
  CHECK(file->number("axis.x", "lead_m") == 0.01);
  CHECK(file->flag("axis.z", "vertical") == true);
  CHECK(file->flag("axis.x", "vertical") == false);
  CHECK(file->list("tool", "broken_teeth") == (std::vector<double>{0, 0.5, 1, 0}));
  CHECK(file->triples("structure.x", "modes") ==
        (std::vector<std::array<double, 3>>{{600, 0.03, 12}, {910.5, 0.02, 7}}));
  CHECK(file->pairs("effect.x.position-dependent-friction", "profile") ==
        (std::vector<std::array<double, 2>>{{0, 12}, {0.1, 14.5}}));
  CHECK_TEXT(file->text("effect.x.backlash", "provenance").value_or(""), "run 7, idle, 2024-05-01");
  CHECK(file->list("monitor.collision", "notch_hz") == (std::vector<double>{50, 100}));
  CHECK(file->number("effect.spindle.coulomb-friction", "torque_Nm") == 0.4);

  // Every key of the table is in that file or is the same key of a neighbouring section, and the
  // user's page names it.
  const std::string page = file_text("docs/files.md");
  for (const MachineKey& key : machine_keys()) {
    const std::string name(key.name);
    const bool documented = page.find("`" + name + "`") != std::string::npos;
    const bool tried = file->text().find(name + " =") != std::string::npos;
    ++check::checks;
    if (!documented || !tried)
      check::fail(__FILE__, __LINE__) << name << (tried ? "" : " is not in " + path)
                                      << (documented ? "" : " is not in docs/files.md") << '\n';
  }
  for (const auto names : {effect_names(), monitor_names()})
    for (const std::string_view name : names)
      CHECK(page.find("`" + std::string(name) + "`") != std::string::npos);

  std::set<std::pair<std::string_view, std::string_view>> unique;
  for (const MachineKey& key : machine_keys()) CHECK(unique.emplace(key.family, key.name).second);
}

void test_errors() {
  malformed::check_all("machine", 30, [](const std::string& path) {
    const Expected<MachineFile> file = MachineFile::read(path);
    return file ? Error{} : file.error();
  });
  const auto sentence = [](const std::string& text) {
    const Expected<MachineFile> file = MachineFile::parse(text, "m.ini");
    return file ? std::string() : file.error().sentence;
  };
  CHECK(sentence(std::string(MachineFile::kLargest + 1, '\n')).find("larger than 1 MiB") !=
        std::string::npos);
  CHECK_TEXT(sentence(std::string(MachineFile::kLargest, '\n')), "");
  CHECK_TEXT(sentence("[axis.x]\nlead_m=0.01\n[spindle]\ninertai_kg_m2=1\n"),
             "m.ini:4: unknown key 'inertai_kg_m2' in [spindle]; the nearest known one is "
             "'inertia_kg_m2'");
  // Every fault has its line; keys of an unknown section are not judged, those behind a fault are.
  CHECK_TEXT(sentence("x = 1\n[spindel]\na = 1\n[axis.x]\nlead_m = far\nlead = 1\nlead_m = 0.01\n"),
             "m.ini:1: key 'x' stands above the first section; put it under one, like [spindle]\n"
             "m.ini:2: unknown section '[spindel]'; the nearest known one is [spindle]\n"
             "m.ini:5: 'lead_m': expected a number greater than 0 and at most 1 [m], found 'far'; "
             "correct the value or remove the line\n"
             "m.ini:6: unknown key 'lead' in [axis.x]; the nearest known one is 'lead_m'\n"
             "m.ini:7: 'lead_m' in [axis.x] is given on line 5 already; remove one of them");
  std::string many;
  for (int i = 0; i < 30; ++i) many += "[spindel]\n";
  const std::string told = sentence(many);
  CHECK(std::count(told.begin(), told.end(), '\n') == 20);
  CHECK(told.ends_with("\nand 10 more of the kind"));
  for (const char* path : {"tests/data", "tests/data/absent.ini"}) {
    const Expected<MachineFile> file = MachineFile::read(path);
    CHECK(!file && file.error().kind == ErrorKind::device);
    CHECK(!file && file.error().sentence.starts_with(path));
  }
}

void test_required() {
  const MachineFile file =
      file_of("# head\n[axis.x]\nvertical = no\n[structure.x]\nmodes = 1 0.1 2\n");
  const auto sentence = [&](const char* section, const char* key) {
    const Expected<double> value = file.required_number(section, key);
    return value ? std::string() : value.error().sentence;
  };
  CHECK_TEXT(sentence("axis.x", "lead_m"),
             "memory:2: [axis.x] has no 'lead_m'; write 'lead_m = ...' under [axis.x] (travel per "
             "turn of the screw, a number greater than 0 and at most 1 [m])");
  CHECK_TEXT(sentence("spindle", "inertia_kg_m2"),
             "memory: there is no section [spindle]; write 'inertia_kg_m2 = ...' under [spindle] "
             "(inertia of all that turns, a number greater than 0 [kg m2])");
  CHECK(sentence("structure.x", "modes").starts_with("memory:5: 'modes' is not one number"));
  CHECK(!file.number("axis.x", "vertical") && !file.flag("structure.x", "modes"));
  CHECK(!file.list("structure.x", "modes") && !file.pairs("structure.x", "modes"));
  CHECK_TEXT(file.where("axis.x", "vertical"), "memory:3");
  CHECK_TEXT(file.where("axis.x", "lead_m"), "memory:2");
  CHECK_TEXT(file.where("tool"), "memory");
}

void test_editing() {
  MachineFile file = file_of(
      "# the mill\n\n[spindle]   # 5 kW\n  inertia_kg_m2=0.1   # from the drawing\n"
      "coulomb_friction_Nm = 0.4# warm\n\n# feed drives\n[axis.x]\nlead_m = 0.01");
  file.set("spindle", "inertia_kg_m2", 0.125);
  file.set("spindle", "coulomb_friction_Nm", 0.5, "idle run 7");
  file.set("spindle", "rated_power_W", 5000);
  file.set("spindle", "current_is_ratio", true);
  file.set("axis.x", "vertical", false, "lies flat");
  file.set("machine", "name", "M #3\nlead_m = 9");
  file.set("tool", "throw_m", std::vector<double>{1e-5, -2.5e-6});
  file.set("structure.x", "modes",
           std::vector<std::array<double, 3>>{{600, 0.03, 12}, {9e2, 0.02, 7}});
  CHECK_TEXT(file.text(),
             "# the mill\n\n[spindle]   # 5 kW\n  inertia_kg_m2=0.125   # from the drawing\n"
             "coulomb_friction_Nm = 0.5  # idle run 7\nrated_power_W = 5000\n"
             "current_is_ratio = yes\n\n# feed drives\n[axis.x]\nlead_m = 0.01\n"
             "vertical = no  # lies flat\n\n[machine]\nname = M  3 lead_m = 9\n\n[tool]\n"
             "throw_m = 1e-05, -2.5e-06\n\n[structure.x]\nmodes = 600 0.03 12, 900 0.02 7\n");
  CHECK(MachineFile::parse(file.text(), "again").has_value());
  CHECK(file.number("spindle", "inertia_kg_m2") == 0.125);
  CHECK(file.sections() ==
        (std::vector<std::string>{"spindle", "axis.x", "machine", "tool", "structure.x"}));
  CHECK_TEXT(file.where("tool", "throw_m"), "memory:18");

  file.remove("spindle", "coulomb_friction_Nm");
  file.remove("spindle", "coulomb_friction_Nm");
  file.remove_section("machine");
  CHECK(!file.has("spindle", "coulomb_friction_Nm") && !file.has_section("machine"));
  CHECK(file.has("spindle", "rated_power_W"));
  CHECK(MachineFile::parse(file.text(), "again").has_value());

  MachineFile windows = file_of("\xEF\xBB\xBF[spindle]\r\ninertia_kg_m2 = 1\r\n");
  windows.set("spindle", "coulomb_friction_Nm", 2);
  CHECK_TEXT(windows.text(),
             "\xEF\xBB\xBF[spindle]\r\ninertia_kg_m2 = 1\r\ncoulomb_friction_Nm = 2\r\n");

  MachineFile empty = file_of("");
  empty.set("effect.x.backlash", "width_m", 2.1e-5);
  CHECK_TEXT(empty.text(), "[effect.x.backlash]\nwidth_m = 2.1e-05\n");

  // What is no UTF-8 is spelt out: the file can be read again.
  MachineFile odd = file_of("");
  odd.set("machine", "name", "mill \x8b\x7f");
  CHECK_TEXT(odd.text(), "[machine]\nname = mill \\x8b\\x7f\n");
  CHECK(MachineFile::parse(odd.text(), "again").has_value());
}

void test_write() {
  const std::string path = "test_machine_file_scratch.ini";
  MachineFile file = file_of("[spindle]\ninertia_kg_m2 = 1  # kept\n");
  file.set("spindle", "torque_constant_Nm_per_A", 1.25);
  CHECK(file.write(path));
  CHECK_TEXT(file_text(path), file.text());
  // What could not be read again is not written.
  const std::string before = file.text();
  file.set("spindle", "inertia_kg_m2", std::numeric_limits<double>::quiet_NaN());
  const Expected<Done> refused = file.write(path);
  CHECK(!refused && refused.error().sentence.find("inertia_kg_m2") != std::string::npos);
  CHECK_TEXT(file_text(path), before);
  std::remove(path.c_str());

  const MachineFile good = file_of(before);
  const Expected<Done> nowhere = good.write("tests/absent/m.ini");
  CHECK(!nowhere && nowhere.error().kind == ErrorKind::device);
  if (std::ifstream("/dev/full")) CHECK(!good.write("/dev/full"));
}

/// Random numbers set and read back bit for bit; random layouts kept byte for byte.
void test_round_trips() {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    std::mt19937_64 random(seed);
    std::string text;
    const std::vector<std::string> blocks = {"[spindle]",         "[axis.x] # x",
                                             "[tool]\t",          " [cut]",
                                             "[monitor.chatter]", "[observer.spindle]"};
    std::vector<std::string> order = blocks;
    std::shuffle(order.begin(), order.end(), random);
    const auto filler = [&] {
      constexpr std::array<const char*, 6> kinds = {"",         "\n",  "# note = [x]\n",
                                                    "  \t\r\n", "#\n", "\r\n"};
      return std::string(kinds[random() % kinds.size()]);
    };
    text += filler();
    for (const std::string& heading : order) {
      text += heading + (random() % 2 ? "\n" : "\r\n") + filler();
      if (heading == "[spindle]") text += " rated_power_W\t=  4e3 # W\n" + filler();
      if (heading == "[tool]\t") text += "teeth=4#four\r\n" + filler();
    }
    MachineFile file = file_of(text);
    const double inertia = std::ldexp(static_cast<double>(random() >> 11U) + 1, -60);
    const double lead = std::ldexp(static_cast<double>(random() >> 11U) + 1, -54);
    const bool kept = file.text() == text;
    file.set("spindle", "inertia_kg_m2", inertia);
    file.set("axis.x", "lead_m", lead);
    file.set("axis.y", "lead_m", lead);
    const Expected<MachineFile> again = MachineFile::parse(file.text(), "again");
    const bool same =
        kept && again && again->number("spindle", "inertia_kg_m2") == inertia &&
        again->number("axis.x", "lead_m") == lead && again->number("axis.y", "lead_m") == lead &&
        again->number("tool", "teeth") == 4 && again->number("spindle", "rated_power_W") == 4000;
    ++check::checks;
    if (!same) check::fail(__FILE__, __LINE__) << "round trip, seed " << seed << '\n';
  }
}

/// Whatever the folder is called.
void files_beside() {
  for (const char* folder : {"/home/m 1", "/tmp/Fr\xE4se # 2", "/a\nb", "machines"}) {
    const std::string where(folder);
    auto file = MachineFile::parse("[machine]\nname = m\n", where + "/m.ini");
    CHECK(file && file->beside("frf.csv") == where + "/frf.csv");
    CHECK(file->beside("/data/frf.csv") == "/data/frf.csv");
  }
  CHECK_TEXT(MachineFile::parse("", "m.ini")->beside("frf.csv"), "frf.csv");
}

}  // namespace

int main() {
  files_beside();
  test_every_key();
  test_errors();
  test_required();
  test_editing();
  test_write();
  test_round_trips();
  return check::done();
}
