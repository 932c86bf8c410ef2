// Random NC programs of everything that the reader knows: words, expressions, parameters, O words,
// cycles, offsets, tools. Some hold a line that is wrong.
//
// Left out is what `rs274` alone does otherwise (docs/nc-program.md): U V W, G43 beside M6, reading
// of parameters that hold lengths of the machine, G96 without D.
#pragma once

#include <cstdio>
#include <random>
#include <string>
#include <vector>

class ProgramGenerator {
 public:
  struct Options {
    bool compensation = false;
    bool wrong_lines = true;
  };
  ProgramGenerator(unsigned seed, Options options) : random_(seed), options_(options) {}

  std::string program() {
    text_ = coin(0.1) ? "%\n" : "";
    const bool percent = !text_.empty();
    line("G17 G90 G94 F" + whole(10, 900) + ".5" + " S" + whole(100, 9000));
    line("T3 M6");
    const int subs = die(3);
    for (int i = 0; i < subs; ++i) subroutine(i);
    const int blocks = 8 + die(30);
    const int wrong = options_.wrong_lines && coin(0.2) ? die(blocks) : -1;
    for (int i = 0; i < blocks; ++i) {
      if (i == wrong) line(wrong_line());
      if (options_.compensation && coin(0.06)) contour();
      item(0);
    }
    if (coin(0.1)) line("O77 CALL [" + value() + "]");
    text_ += "M" + std::string(coin(0.5) ? "2" : "30") + "\n";
    text_ += "O77 sub\n G0 X#1\nO77 endsub [#1*2]\n";
    for (int i = 0; i < 2; ++i)
      text_ += "O" + std::to_string(800 + i) + "\nG91 G0 X" + number(-3, 3) + "\nM99\n";
    return text_ + (percent ? "%\n" : "");
  }

 private:
  int die(int sides) { return static_cast<int>(random_() % static_cast<unsigned>(sides)); }
  bool coin(double chance) {
    return std::uniform_real_distribution<double>(0, 1)(random_) < chance;
  }
  double between(double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random_);
  }
  std::string digits(double v) {
    char out[40];
    std::snprintf(out, sizeof out, "%.*f", 1 + die(5), v);
    std::string s = out;
    if (coin(0.1) && s.starts_with("0.")) s.erase(0, 1);
    return s;
  }
  std::string exact(double v) {
    char out[40];
    std::snprintf(out, sizeof out, "%.7f", v);
    return out;
  }
  std::string number(double a, double b) { return digits(between(a, b)); }
  std::string whole(int a, int b) { return std::to_string(a + die(b - a + 1)); }

  void line(const std::string& words) {
    std::string out;
    if (words.size() > 180) return line("G0 X" + number(-5, 5));  // near to what a line may hold
    if (coin(0.04) && words[0] != 'O') out += "/";
    number_ += 10;
    if (!words.empty() && words[0] != 'O') out += "N" + std::to_string(number_) + " ";
    for (const char c : words) {
      out += coin(0.3) && c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
      if (c == ' ' && coin(0.1)) out += ' ';
    }
    if (coin(0.05)) out += " (remark)";
    if (coin(0.05)) out += " ; remark (";
    text_ += out + "\n";
  }

  std::string parameter() {
    switch (die(5)) {
      case 0:
        return "#<_g" + whole(1, 3) + ">";
      case 1:
        return "#[" + whole(1, 9) + "+1]";
      default:
        return "#" + whole(1, 12);
    }
  }
  /// Any value, of no great size.
  std::string expression(int depth) {
    if (depth > 2 || coin(0.3)) return coin(0.5) ? "#" + whole(1, 12) : number(-20, 20);
    const std::string a = expression(depth + 1), b = expression(depth + 1);
    switch (die(18)) {
      case 0:
        return "[" + a + " + " + b + "]";
      case 1:
        return "[" + a + "-" + b + "]";
      case 2:
        return "[" + a + " * " + b + " MOD 40]";
      case 3:
        return "[" + a + " / [ABS[" + b + "] + 1]]";
      case 4:
        return "[" + a + " MOD [ABS[" + b + "] + 1]]";
      case 5:
        return "SIN[" + a + "]";
      case 6:
        return "[COS[" + a + "] * 10]";
      case 7:
        return "ATAN[" + a + "]/[" + b + "+0.0123]";
      case 8:
        return "SQRT[ABS[" + a + "]]";
      case 9:
        return "ROUND[" + a + "]";
      case 10:
        return "FIX[" + a + "]";
      case 11:
        return "FUP[" + a + "]";
      case 12:
        return "[" + a + " GT " + b + "]";
      case 13:
        return "[" + a + " LE " + b + " AND " + a + " NE 3 OR 0]";
      case 14:
        return "[[" + a + " MOD 3] ** 2]";
      case 15:
        return "-" + a;
      case 16:
        return "[ASIN[SIN[" + a + "]*0.9] + LN[2 + ABS[" + b + "]] + EXP[-ABS[" + a + "]]]";
      default:
        return "[" + a + " XOR " + b + " + TAN[[" + a + " MOD 60]] MOD 50 - ACOS[0.3]/10]";
    }
  }
  std::string value() {
    if (coin(0.75)) return number(-30, 30);
    const std::string e = expression(0);
    return "[[" + e + "] MOD 100]";
  }
  std::string axes(bool rotary) {
    std::string out;
    for (const char c : std::string("XYZ"))
      if (coin(0.6)) out += " " + std::string(1, c) + value();
    if (rotary)
      for (const char c : std::string("ABC"))
        if (coin(0.06)) out += " " + std::string(1, c) + number(-300, 300);
    return out;
  }

  void item(int depth) {
    switch (die(depth < 3 ? 26 : 20)) {
      case 0:
      case 1:
      case 2:
        straight();
        break;
      case 3:
      case 4:
      case 5:
        arc();
        break;
      case 6:
        plane();
        break;
      case 7:
        offsets();
        break;
      case 8:
        cycle();
        break;
      case 9:
        feed_mode();
        break;
      case 10:
        tools();
        break;
      case 11:
        spindle();
        break;
      case 12:
      case 13:
        assignment();
        break;
      case 14:
        home();
        break;
      case 15:
        polar();
        break;
      case 16:
        // Of a tool offset in force `rs274` alone forgets the units.
        text_ += "G49\n";
        line(coin(0.5) ? "G20" : "G21");
        text_ += "F" + whole(10, 300) + "\n";  // and of the feed
        break;
      case 17:
        line(coin(0.6) ? "G90" : "G91");
        break;
      case 18:
        modal();
        break;
      case 19:
        call();
        break;
      case 20:
        branch(depth);
        break;
      case 21:
        loop(depth);
        break;
      default:
        straight();
    }
  }

  void straight() {
    if (inverse_) return line("G1" + axes(true) + " F" + whole(1, 20) + ".5");
    line(std::string(coin(0.1)   ? ""
                     : coin(0.5) ? "G0"
                                 : "G1") +
         axes(true) + (coin(0.2) ? " F" + whole(1, 2000) : ""));
  }
  /// Ends on its circle: from any place under G91.
  void arc() {
    const std::string words[3] = {"XYZIJK", "ZXYKIJ", "YZXJKI"};
    const std::string& w = words[plane_];
    const double i = between(-9, 9), j = between(0.3, 9), angle = between(0.2, 6.1);
    const double a = i - (i * std::cos(angle) - j * std::sin(angle)),
                 b = j - (i * std::sin(angle) + j * std::cos(angle));
    const std::string code = std::string(coin(0.5) ? "G2" : "G3");
    const auto word = [&](int which, double v) {
      return " " + std::string(1, w[static_cast<std::size_t>(which)]) + exact(v);
    };
    std::string rest = coin(0.4) ? word(2, between(-5, 5)) : "";
    if (coin(0.2)) rest += " P" + whole(1, 4);
    if (inverse_) rest += " F" + whole(1, 20) + ".5";
    switch (die(4)) {
      case 0:  // full circle
        line(code + word(3, i) + word(4, j) + rest);
        break;
      case 1: {  // by its radius
        const double half = std::hypot(a, b) / 2;
        const double r = half * between(1.001, 3) * (coin(0.3) ? -1 : 1);
        line("G91 " + code + word(0, a) + word(1, b) + " R" + exact(r) + rest);
        if (coin(0.7)) line("G90");
        break;
      }
      case 2:
        line("G90.1 " + code + word(3, between(40, 60)) + word(4, between(40, 60)) + rest);
        line("G91.1");
        break;
      default:
        line("G91 " + code + word(0, a) + word(1, b) + word(3, i) + word(4, j) + rest);
        if (coin(0.7)) line("G90");
    }
  }
  /// A contour with the tool beside it: corners of all kinds, some of which no tool fits into.
  void contour() {
    line(inverse_ ? "G94 F300" : "G40");
    inverse_ = false;
    const bool zx = coin(0.2);
    line(zx ? "G18" : "G17");
    plane_ = zx ? 1 : 0;
    const char a = zx ? 'Z' : 'X', b = zx ? 'X' : 'Y', i = zx ? 'K' : 'I', j = zx ? 'I' : 'J';
    const auto pair = [&](double x, double y) {
      return std::string(" ") + a + exact(x) + " " + b + exact(y);
    };
    line("G90 G0" + pair(-20, 0) + (coin(0.5) ? (zx ? " Y2" : " Z2") : ""));
    const std::string side = coin(0.5) ? "G41" : "G42";
    switch (die(3)) {
      case 0:
        line(side + ".1 D" + number(0.2, 6));
        break;
      case 1:
        line(side + " D" + whole(1, 4));
        break;
      default:
        line(side);
    }
    line("G91");
    double heading = between(-0.5, 0.5);
    line("G1" + pair(12 * std::cos(heading), 12 * std::sin(heading)));
    for (int k = 2 + die(6); k > 0; --k) {
      heading += coin(0.2) ? 0 : coin(0.93) ? between(-1.3, 1.3) : between(-3.1, 3.1);
      if (coin(0.6)) {
        const double length = between(4, 25);
        line(std::string(coin(0.1) ? "G0" : "G1") +
             pair(length * std::cos(heading), length * std::sin(heading)) +
             (coin(0.1) ? (zx ? " Y-1" : " Z-1") : ""));
      } else {
        // Begins in this direction.
        const bool left = coin(0.5);
        const double r = between(1, 15), angle = between(0.2, 4) * (left ? 1 : -1);
        const double to_centre = heading + (left ? 1.5707963267948966 : -1.5707963267948966);
        const double ci = r * std::cos(to_centre), cj = r * std::sin(to_centre);
        line(std::string(left ? "G3" : "G2") +
             pair(ci - ci * std::cos(angle) + cj * std::sin(angle),
                  cj - ci * std::sin(angle) - cj * std::cos(angle)) +
             " " + i + exact(ci) + " " + j + exact(cj) + (coin(0.1) ? (zx ? " Y-1" : " Z-1") : ""));
        heading += angle;
      }
      if (coin(0.1)) line(zx ? "G1 Y1" : "G1 Z1");
      if (coin(0.1)) line("M8");
      if (coin(0.1)) line("F" + whole(50, 500));
    }
    line("G40");
    line("G90 G0" + pair(between(-50, 50), between(-50, 50)));
  }
  void plane() {
    plane_ = die(3);
    line("G" + std::to_string(17 + plane_));
  }
  void offsets() {
    switch (die(11)) {
      case 0:
        return line("G92" + axes(true) + " X" + value());
      case 1:
        return line("G92.1");
      case 2:
        return line("G92.2");
      case 3:
        return line("G92.3");
      case 4:
        return line("G52 Z" + value());
      case 5:
        return line("G5" + whole(4, 9));
      case 6:
        return line("G59." + whole(1, 3));
      case 7:
        return line("G10 L2 P" + whole(0, 9) + axes(true) +
                    (coin(0.3) ? " R" + number(-90, 90) : ""));
      case 8:
        return line("G10 L20 P" + whole(0, 9) + axes(true));
      case 9:
        return line("G10 L" +
                    std::string(coin(0.5)   ? "1"
                                : coin(0.5) ? "10"
                                            : "11") +
                    " P" + whole(1, 9) + " Z" + number(-9, 60) +
                    (coin(0.3) ? " X" + number(-3, 3) : "") +
                    (coin(0.3) ? " R" + number(0.5, 6) : ""));
      default:
        return line("G90 G53 G0" + axes(true));
    }
  }
  void cycle() {
    if (inverse_) {
      line("G94 F" + whole(50, 500));
      inverse_ = false;
    }
    const bool incremental = coin(0.25);
    line(std::string(incremental ? "G91 " : "G90 ") + (coin(0.5) ? "G98" : "G99"));
    const std::string word = std::string(1, "ZYX"[plane_]);
    const std::string p = " P" + number(0, 3), q = " Q" + number(0.4, 4);
    const std::string level = incremental ? word + number(-6, -1) + " R" + number(-2, 4)
                                          : word + number(-9, -1) + " R" + number(0, 5);
    const std::string where = " " + std::string(1, "XZY"[plane_]) + value() +
                              (coin(0.6) ? " " + std::string(1, "YXZ"[plane_]) + value() : "");
    line("M3");
    static const char* const codes[] = {"81", "82", "83", "73", "85", "86", "87", "88", "89", "84"};
    const std::string code = codes[die(plane_ == 0 ? 10 : 9)];
    if (code == "84") line("G17");  // in other planes that of `rs274` goes elsewhere
    std::string rest;
    if (code == "82" || code == "86" || code == "88" || code == "89") rest = p;
    if (code == "83" || code == "73") rest = q;
    if (code == "87") rest = " I" + number(-1, 1) + " J" + number(-1, 1) + " K" + number(-1, 1);
    if (coin(0.2)) rest += " L" + whole(1, 4);
    line("G" + code + where + " " + level + rest);
    if (coin(0.5))
      line(where.substr(1) + (coin(0.3) ? " R" + number(0, 3) : "") + (coin(0.2) ? " L2" : ""));
    line(coin(0.5) ? "G80" : "G0 X1");
    line("G90");
  }
  void feed_mode() {
    switch (die(3)) {
      case 0:
        inverse_ = true;
        return line("G93");
      case 1:
        inverse_ = false;
        return line("G95 F0." + whole(1, 9) + " S" + whole(50, 900));
      default:
        inverse_ = false;
        return line("G94 F" + whole(10, 900));
    }
  }
  void tools() {
    switch (die(8)) {
      case 0:
        // `rs274` alone takes the last point that it printed for the place after a tool change.
        line("G90 G0 X" + number(-9, 9) + " Y" + number(-9, 9) + " Z" + number(0, 9) + " A0 B0 C0");
        return line("T" + whole(1, 20) + " M6");
      case 1:
        return line("T" + whole(1, 20));
      case 2:
        return line("G43");
      case 3:
        return line("G43 H" + whole(1, 20));
      case 4:
        return line("G43.1 Z" + number(-9, 9));
      case 5:
        return line("G43.2 H" + whole(1, 20));
      case 6:
        line("G90 G0 X1 Y" + number(-9, 9) + " Z" + number(0, 9) + " A0 B0 C0");
        line("M61 Q" + whole(1, 20));
        return line("T" + whole(1, 20) + " M6");  // M61 of `rs274` alone loads no offsets
      default:
        return line("G49");
    }
  }
  void spindle() {
    static const char* const lines[] = {"M3 S500", "M4",       "M5",     "M7",       "M8",
                                        "M9",      "M0",       "M1",     "M48",      "M49",
                                        "M50 P0",  "M52 P1",   "M53 P0", "G4 P0.25", "M60",
                                        "M19 R30", "G97 S800", "M62 P1", "M64 P2",   "M68 E1 Q2"};
    line(lines[die(20)]);
    if (coin(0.2)) {
      line("M3");
      line("G33.1 K" + number(0.2, 2) + " Z" + number(-9, 0));
    }
    if (coin(0.1)) {
      line("M4");
      line("G33 K" + number(0.2, 2) + " Z" + number(-9, 0));
    }
  }
  void assignment() {
    std::string out = parameter() + "=" + value();
    if (coin(0.2)) out += " " + parameter() + " = #" + whole(1, 12);
    if (coin(0.2)) out += " G0 X#" + whole(1, 12);
    line(out);
    if (coin(0.2))
      line("G0 X#5420 Y#<_y> Z[#5422 + EXISTS[#<nobody>] + #<_metric> + #<_absolute>]");
  }
  void home() {
    static const char* const lines[] = {"G28",    "G30",       "G28.1",     "G30.1",
                                        "G28 Z5", "G30 X1 Y2", "G91 G28 Z0"};
    line(lines[die(7)]);
  }
  void polar() {
    if (plane_ != 0) return;
    line("G90 G0 X" + number(1, 9) + " Y" + number(1, 9));
    line("@" + number(1, 30) + " ^" + number(-180, 180));
    line(coin(0.5) ? "^" + number(0, 90) : "@" + number(3, 9));
  }
  void modal() {
    static const char* const lines[] = {"G61", "G61.1", "G64", "G64 P0.05", "G64 P0.05 Q0.02",
                                        "G98", "G99",   "G80", "M70",       "G40",
                                        "G8"};
    const int which = die(10);
    if (which == 8 && inverse_) return straight();
    line(lines[which]);
    if (which == 8) {
      straight();
      line(coin(0.8) ? "M72" : "M71");
    }
  }
  void call() {
    inverse_ = false;
    line("G94 F" + whole(50, 900) + ".5");  // M73 of `rs274` restores a feed to one decimal
    switch (die(4)) {
      case 0:
        return line("O77 call [" + value() + "]");
      case 1:
        return line("M98 P" + whole(800, 801) + (coin(0.5) ? " L" + whole(1, 3) : ""));
      default:
        if (subs_.empty()) return straight();
        line("O" + subs_[static_cast<std::size_t>(die(static_cast<int>(subs_.size())))] +
             " call [" + number(-30, 30) + "] [" + number(-30, 30) + "]");
        if (coin(0.4)) line("G0 X[[#<_value>] MOD 50] Y#<_value_returned>");
    }
  }
  void branch(int depth) {
    const std::string label = "O" + std::to_string(++label_);
    line(label + " if [" + value() + " GT " + value() + "]");
    body(depth);
    if (coin(0.4)) {
      line(label + " elseif [" + value() + " LT " + value() + "]");
      body(depth);
    }
    if (coin(0.5)) {
      line(label + " else");
      body(depth);
    }
    line(label + " endif");
  }
  void loop(int depth) {
    const std::string label = "O" + std::to_string(++label_);
    const std::string counter = "#" + std::to_string(40 + label_ % 50);
    const std::string inner = "O" + std::to_string(++label_);
    switch (die(3)) {
      case 0:
        line(label + " repeat [" + whole(0, 3) + "]");
        body(depth);
        line(label + " endrepeat");
        break;
      case 1:
        line(counter + "=0");
        line(label + " while [" + counter + " LT " + whole(1, 4) + "]");
        text_ += counter + "=[" + counter + "+1]\n";  // never left out
        if (coin(0.4)) {
          line(inner + " if [" + counter + " EQ 2]");
          line(label + (coin(0.5) ? " continue" : " break"));
          line(inner + " endif");
        }
        body(depth);
        line(label + " endwhile");
        break;
      default:
        line(counter + "=0");
        line(label + " do");
        text_ += counter + "=[" + counter + "+1]\n";  // never left out
        if (coin(0.3)) {
          line(inner + " if [" + counter + " EQ 2]");
          line(label + " break");
          line(inner + " endif");
        }
        body(depth);
        line(label + " while [" + counter + " LT " + whole(1, 4) + "]");
    }
  }
  void body(int depth) {
    for (int i = 1 + die(3); i > 0; --i) item(depth + 1);
  }
  void subroutine(int index) {
    const std::string name =
        index == 0 ? "<slot " + whole(1, 9) + ">" : std::to_string(500 + index);
    line("O" + name + " sub");
    const bool restores = coin(0.4);
    if (restores) line("M73");
    line("#<own>=[#1+#2]");
    line("G91 G0 X[[#<own>] MOD 20]");
    line("G90");
    if (restores) {
      for (int i = 0; i < 3; ++i) straight();
      static const char* const lines[] = {"G18",     "G90.1",    "G61", "G98",   "G55",
                                          "M4 S150", "G43.1 Z3", "M8",  "F77.5", "G49"};
      for (int i = 0; i < 3; ++i) line(lines[die(10)]);
    } else {
      body(2);
    }
    if (coin(0.3)) {
      const std::string label = "O" + std::to_string(++label_);
      line(label + " if [#1 GT 0]");
      line("O" + name + " return [#<own>]");
      line(label + " endif");
    }
    line("O" + name + " endsub" + (coin(0.5) ? " [#1 + 1]" : ""));
    subs_.push_back(name);
  }

  std::string wrong_line() {
    static const char* const lines[] = {"G0 X",
                                        "G0 X1 X2",
                                        "G0 G1 X1",
                                        "M3 M5",
                                        "X[1/0]",
                                        "G0 X[2",
                                        "G0 Xsqrt[-1]",
                                        "G2 X1",
                                        "G1 X1 F-1",
                                        "S-1",
                                        "G4",
                                        "G10 L2 P10 X1",
                                        "G10 L3 P1",
                                        "G53 G2 X1 I1",
                                        "G91 G53 G0 X1",
                                        "#5421=1",
                                        "#0=1",
                                        "#<_x>=1",
                                        "G0 X#<nobody>",
                                        "G81 X1 R1",
                                        "G81 X1 Z2 R1",
                                        "G82 X1 Z-1 R1",
                                        "G83 X1 Z-1 R1",
                                        "G83 X1 Z-1 R1 Q0",
                                        "G87 X1 Z-1 R1",
                                        "G81 A1 Z-1 R1",
                                        "G92",
                                        "G80 X1",
                                        "G28 G1 X1",
                                        "G2 X1 Y1 R0.1",
                                        "G2 X5 I1",
                                        "G2 X5 Y5 I1 R2",
                                        "G17 G2 X1 K1",
                                        "P1",
                                        "Q1",
                                        "H1",
                                        "D1",
                                        "L1",
                                        "I1 M5",
                                        "G33 Z-1",
                                        "G33.1 Z-1 K1 F5",
                                        "M6 T999",
                                        "T-1",
                                        "G43 H99",
                                        "T1.5",
                                        "G43 H1.5",
                                        "M77",
                                        "G77",
                                        "G1.55",
                                        "M-1",
                                        "N G0",
                                        "(a (b)",
                                        "(open",
                                        "O99 endif",
                                        "O99 foo",
                                        "O99 if 1",
                                        "O99 break",
                                        "O99 call",
                                        "M98",
                                        "M72",
                                        "G0 X1 ? Y2",
                                        "G0 X--+1.5.5",
                                        "E1",
                                        "K1",
                                        "@5",
                                        "^10 X1",
                                        "M19 P3",
                                        "M19 R400",
                                        "G96 D100",
                                        "M62",
                                        "M66",
                                        "G0 X[1 FOO 2]",
                                        "G0 Xfoo[1]",
                                        "G0 Xsin 1",
                                        "#1 2",
                                        "G0 X[ACOS[2]]",
                                        "G0 XLN[0]",
                                        "M3 M7 M48 M0 M6",
                                        "G2 X1 Y1 R5 P0",
                                        "G3 X1 Y1 R5 P1.5",
                                        "G43.1",
                                        "G52",
                                        "O1[2] sub"};
    return lines[die(static_cast<int>(std::size(lines)))];
  }

  std::mt19937_64 random_;
  Options options_;
  std::string text_;
  int number_ = 0, label_ = 100, plane_ = 0;
  bool inverse_ = false;
  std::vector<std::string> subs_;
};
