/* Tait's law in several forms, as loops over particles of several types: the form whose roundings LAMMPS' output shows,
 * and one that takes the difference of densities first. All loops read and write the same arrays. */
#include <math.h>

struct law { double csq, rho0, rho0inv, gamma; };
#define LOOP(NAME, PRESSURE) \
  void NAME(long n, const double *rho_n, const int *type_n, const struct law *law_t, double *p_n) { \
    for (long i = 0; i < n; i++) { \
      const struct law e = law_t[type_n[i]]; \
      const double rho = rho_n[i]; \
      PRESSURE \
    } \
  }

LOOP(water_printed, const double x = rho * e.rho0inv; const double x3 = x * x * x;
     p_n[i] = e.csq * e.rho0 * (1.0 / 7.0) * (x3 * x3 * x - 1.0);)
LOOP(water_difference, const double d = rho - e.rho0; const double y = d * e.rho0inv;
     p_n[i] = e.csq * d * (1.0 + y * (3.0 + y * (5.0 + y * (5.0 + y * (3.0 + y * (1.0 + y * (1.0 / 7.0)))))));)
LOOP(water_factored, const double x = rho * e.rho0inv; const double xx = x * x;
     p_n[i] = e.csq * (1.0 / 7.0) * (rho - e.rho0) * (1.0 + x * (1.0 + x) * (1.0 + xx + xx * xx));)
LOOP(general_printed, p_n[i] = e.csq * e.rho0 * (pow(rho * e.rho0inv, e.gamma) - 1.0) / e.gamma;)
LOOP(general_difference, p_n[i] = e.csq * e.rho0 * expm1(e.gamma * log1p((rho - e.rho0) * e.rho0inv)) / e.gamma;)
