// A plant in C++ that stands still: the header can be included, and its functions are found.
#include <hil.h>

#include <vector>

namespace {

const hil_signal position[] = {{"x_m", "m", "Position.", 0.0, 0.0}};

struct Still {
    std::vector<double> *x_m;
};

int start(void *self, const double *) {
    static_cast<Still *>(self)->x_m = new std::vector<double>{hil_cos(0.0)};
    return HIL_OK;
}
int measure(const void *self, double *row) {
    row[0] = static_cast<const Still *>(self)->x_m->at(0);
    return HIL_OK;
}
int tell_truth(const void *self, double, const double *, double *row) { return measure(self, row); }
int advance(void *, const hil_interval *, const double *) { return HIL_OK; }
void end(void *self) { delete static_cast<Still *>(self)->x_m; }

} // namespace

int main(int argc, char **argv) {
    hil_plant plant = {};
    plant.api = HIL_API;
    plant.name = "still";
    plant.summary = "Stands still.";
    plant.truth = HIL_TABLE(position);
    plant.measured = HIL_TABLE(position);
    plant.size = sizeof(Still);
    plant.start = start;
    plant.measure = measure;
    plant.tell_truth = tell_truth;
    plant.advance = advance;
    plant.end = end;
    return hil_plant_main(argc, argv, &plant);
}
